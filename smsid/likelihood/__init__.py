"""Maximum likelihood: refinement of the linear estimate to the Cramer-Rao bound, and that bound itself."""

from smsid.likelihood._fisher import fisher_information
from smsid.likelihood._profile import profile_interval
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.refine import Refinement, refine

__all__ = [
    "Nuisance",
    "Refinement",
    "fisher_information",
    "profile_interval",
    "refine",
]
