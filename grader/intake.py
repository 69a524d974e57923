"""An archive or a folder as it was handed in → a folder of regular files, within limits."""
