"""The report of a batch: what a lot was, as page, PDF, and tables for a spreadsheet."""
