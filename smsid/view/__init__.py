"""The spacecraft in 3-D: scenes, replays of simulations and recordings, live, as one HTML file, or as a film.

>>> played = replay(model, recording, beside=[("simulated", simulated_twin(model, recording))])
>>> export_html(played, "view.html")

meshcat is needed for `export_html`, `export_video`, `show` and `LiveView` only; importing this starts
nothing.
"""

from smsid._callable import make_callable
from smsid.view._export import export_html
from smsid.view._live import LiveView, show
from smsid.view._look import Look
from smsid.view._main import build_replay, simulated_twin, write_view
from smsid.view._scene import Scene, build_scene
from smsid.view._video import export_video
from smsid.view.replay import Replay, replay

__all__ = [
    "LiveView",
    "Look",
    "Replay",
    "Scene",
    "build_replay",
    "build_scene",
    "export_html",
    "export_video",
    "replay",
    "show",
    "simulated_twin",
    "write_view",
]

make_callable(__name__)  # smsid.view(...) is that of smsid.api
