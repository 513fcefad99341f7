"""How the C-60 should come to rest: what a settling costs, and how far its result is an accident of its steps.

A mechanism with friction rests where its history left it. Each settling closes the clearances of the same samples with
four lengths of steps; where it leaves a sample must not depend on them. Nothing is chosen by the paper's numbers.
"""
