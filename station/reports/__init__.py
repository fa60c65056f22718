"""What people see of a result: report, pictures, tables and words.

Side by side are tables and words that screen, page and PDF share; what is of one of them alone has a room: `figures`,
`pdf_pages`, `templates`.
"""
