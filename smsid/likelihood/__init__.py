"""Maximum likelihood: refinement of the linear estimate to the Cramer-Rao bound, and that bound itself."""

from smsid.likelihood.piece import Nuisance
from smsid.likelihood.refine import Refinement, refine

__all__ = ["Nuisance", "Refinement", "refine"]
