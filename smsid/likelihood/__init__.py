"""Maximum likelihood: refinement of the linear estimate to the Cramer-Rao bound, and that bound itself."""

from smsid.likelihood.fisher import FisherInformation, fisher_information
from smsid.likelihood.nuisance_parameters import Nuisance
from smsid.likelihood.null_space import UnseenDirection
from smsid.likelihood.profile import ProfileInterval, profile_interval
from smsid.likelihood.refine import Refinement, refine

__all__ = [
    "FisherInformation",
    "Nuisance",
    "ProfileInterval",
    "Refinement",
    "UnseenDirection",
    "fisher_information",
    "profile_interval",
    "refine",
]
