"""The languages of pages and mails: catalogues of the English templates, and their use."""
