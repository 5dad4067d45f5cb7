"""What carries whom, which way is up, and how large everything is.

Floor, up, stance and scale are one answer, found before the stages.
"""
