"""The review desk: what of a class needs a person, decided in the browser, written to `overrides.yaml`."""
