"""Effect of the play of the C-60's parts along their axes on its responses: the table of studies/axial_play/README.md.

The drawings define the play of the parts between case and cover, but not their positions in it. Each variant starts the
same samples at other positions, or gives them more play than drawn. Nothing is fitted.
"""
