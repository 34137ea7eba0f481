"""What pages say of the committed results: rows, tables, sentences, and the template they stand in."""
