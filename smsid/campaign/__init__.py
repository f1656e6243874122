"""Monte Carlo campaigns: many runs of a method, with noise and parameters drawn anew, and what they show."""

from smsid.campaign._case import Case, prepare
from smsid.campaign._plan import Campaign, load_campaign
from smsid.campaign.outcome import Findings, Outcome, RunError, RunRecord
from smsid.campaign.run import campaign_main, run_campaign, run_once
from smsid.campaign.store import CampaignStore, read_store
from smsid.campaign.summary import save_summary, summarise

__all__ = [
    "Campaign",
    "CampaignStore",
    "Case",
    "Findings",
    "Outcome",
    "RunError",
    "RunRecord",
    "campaign_main",
    "load_campaign",
    "prepare",
    "read_store",
    "run_campaign",
    "run_once",
    "save_summary",
    "summarise",
]
