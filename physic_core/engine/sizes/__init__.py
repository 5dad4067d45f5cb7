"""Evidence of the size of people and scenes: soles, torsos, statures, and the sizes that the user
knows.

:mod:`.evidence` states each kind as a logarithm of the scale with its sigma, :mod:`.scale_vote`
weighs them, and :mod:`.stature` is the prior of people. :mod:`.known_sizes` compares with sizes of
the user.
"""
