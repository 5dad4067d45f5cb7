"""How accurate a preset is on real photos with measured truth, which lie outside this project."""
