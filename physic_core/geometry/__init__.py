"""Pure functions on tensors: cameras, point maps, alignment, planes, neighbours, visibility, robust losses."""
