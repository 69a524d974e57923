"""Launch files: evaluated in a process of their own, kept as plans. Imports nothing but what lies here."""
