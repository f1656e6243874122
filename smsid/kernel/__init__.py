"""The compiled kernel of simulations whose inputs are held from sample to sample.

numba compiles it (extra ``fast``); without numba its functions are plain Python, and `Kernel.of` returns
``None``, so that simulations go the plain way, over Pinocchio.
"""
