"""How results show themselves: rows of texts with units, text and HTML, a file a result.

The results load their file here when they are shown; the command line does before it loads them.
"""
