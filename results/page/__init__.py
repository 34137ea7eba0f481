"""What results/report.py makes its page of: results as they are read, figures, and the document around them."""
