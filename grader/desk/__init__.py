"""The review desk: questions of a class, answered in the browser, written to `overrides.yaml`."""
