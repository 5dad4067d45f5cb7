"""The commands of the core, each imported when it runs.

Commands of plugins use the modules above this room.
"""
