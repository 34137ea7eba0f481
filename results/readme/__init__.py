"""Computes what the pages say of the committed results: rows, figures of sentences, and tables."""
