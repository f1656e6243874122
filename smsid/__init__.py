"""smsid: identify the dynamics of space manipulator systems from measured data.

The spacecraft is a URDF with a free-flyer root; Pinocchio computes, and slosh masses and bending modes are
joints of the same model. ``import smsid`` is light: no plotting, no web server.
"""

__version__ = "0.1.0"
