"""Columns of the arrays that `smsid.kernel.arrays` makes."""

from __future__ import annotations

# of `tree`; COUPLED is the parent, or what inertia couples besides: of a beam's modes the one before, of the
# twist of a gear the joint
PARENT, KIND, PLACE, TURNING, COUPLED = range(5)
HINGE, SLIDE, ENDLESS = range(3)  # kinds; an endless hinge is stored as (cos, sin)
ROTATION, POSITION, AXIS, MASS, MOMENT, INERTIA = 0, 9, 12, 15, 16, 19  # where they begin in `bodies`
ARMATURE, STIFFNESS, DAMPING, COLUMNS = 25, 26, 27, 28
# of `root`, which begins with mass, moment and inertia of the bus: gravity, whether it is free, how many
# beams and forces stand behind, the time [s], with forces the bus's attitude (x, y, z, w) and that at the
# chart's beginning, how many rotors stand behind the beams, and where the tables of forces begin
GRAVITY, FREE, BEAMS, FORCES, TIME, ATTITUDE, BEGUN, ROTORS, FIRST = 10, 13, 14, 15, 16, 17, 21, 25, 26
