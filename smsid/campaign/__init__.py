"""Monte Carlo campaigns: many runs of a method, with noise and parameters drawn anew, and what they show."""

from smsid.campaign.case import Case, PreparedCampaign, prepare
from smsid.campaign.main import campaign_main
from smsid.campaign.methods import known_methods, register
from smsid.campaign.outcome import Findings, Outcome, RunError, RunRecord
from smsid.campaign.plan import Campaign, Noise, load_campaign
from smsid.campaign.run import Progress, run_campaign, run_once
from smsid.campaign.store import CampaignStore, read_store
from smsid.campaign.summary import ParameterSummary, Summary, save_summary, summarise
from smsid.campaign.table import summary_tables
from smsid.campaign.vary import Variation

__all__ = [
    "Campaign",
    "CampaignStore",
    "Case",
    "Findings",
    "Noise",
    "Outcome",
    "ParameterSummary",
    "PreparedCampaign",
    "Progress",
    "RunError",
    "RunRecord",
    "Summary",
    "Variation",
    "campaign_main",
    "known_methods",
    "load_campaign",
    "prepare",
    "read_store",
    "register",
    "run_campaign",
    "run_once",
    "save_summary",
    "summarise",
    "summary_tables",
]
