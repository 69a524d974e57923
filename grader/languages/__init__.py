"""The languages of pages and mails: catalogues of translations, and English texts translated by them.

English text stands in the code. A catalogue maps templates, such as `{0} messages on {1}`, to their translations; a
finished text is recognised by its template, and its inserted values are translated in turn.
"""
