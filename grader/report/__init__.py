"""Words and layout of a result: HTML page, JSON, terminal. No arithmetic."""
