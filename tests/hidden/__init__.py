"""Worlds in MuJoCo that hide an effect, and the judge of what a diagnosis says about it.

Shares no code with the model, the effects or the simulation of the project under test.
"""
