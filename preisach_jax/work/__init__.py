"""Long work in a folder, chunk by chunk: an interruption loses little."""
