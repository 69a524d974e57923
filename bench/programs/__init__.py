"""Programs of the measurements; each prints one line of JSON at its end."""
