"""The timeline of a session: what happened when, as moments, and as a picture of lanes."""
