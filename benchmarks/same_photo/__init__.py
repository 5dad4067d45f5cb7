"""How much the answer to a photo changes when the photo is mirrored, scaled, cropped, compressed or
grey.
"""
