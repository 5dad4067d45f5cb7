"""The packaged networks: opening them, cutting their inputs out of a photo, reading their outputs."""
