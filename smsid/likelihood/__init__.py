"""Maximum likelihood: refinement of the linear estimate to the Cramer-Rao bound, and that bound itself."""

from smsid.likelihood.bootstrap import Bootstrap, bootstrap
from smsid.likelihood.fisher import FisherInformation, fisher_information
from smsid.likelihood.local import Nuisance
from smsid.likelihood.profile import ProfileInterval, profile_interval
from smsid.likelihood.refine import Refinement, refine
from smsid.likelihood.unseen import UnseenDirection

__all__ = [
    "Bootstrap",
    "FisherInformation",
    "Nuisance",
    "ProfileInterval",
    "Refinement",
    "UnseenDirection",
    "bootstrap",
    "fisher_information",
    "profile_interval",
    "refine",
]
