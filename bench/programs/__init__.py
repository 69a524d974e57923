"""Programs that the measurements start; each prints one line of JSON at its end."""
