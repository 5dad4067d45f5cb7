"""The commands ``physic setup``, ``weights fetch``, ``config init`` and ``config schema``."""
