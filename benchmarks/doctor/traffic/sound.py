"""Sound trackers of several objects, on which any finding is wrong."""

from __future__ import annotations

from functools import partial

from ..filterpy_ekf import FilterPyEkf
from ..plain_kf import PlainKf
from .greedy_score import GreedyScore
from .ipda import Ipda
from .nearest_global import NearestGlobal
from .subject import Make, TrafficSubject, built_in, looped

_own = partial(looped, NearestGlobal)

SOUND: dict[str, Make] = {
    **{f"builtin {method}": built_in(method) for method in ("gnn", "jpda", "jipda", "pmb")},
    "builtin gnn by score": built_in("gnn", confirm="score"),
    "builtin jpda by score, kf": built_in("jpda", "kf", confirm="score"),
    "builtin gnn ukf ctrv": built_in("gnn", "ukf", "ctrv"),
    "builtin pmb ukf ctrv": built_in("pmb", "ukf", "ctrv"),
    "builtin jipda kf, calm": built_in("jipda", "kf", "cv", 1.0),
    "builtin pmb lively": built_in("pmb", "ekf", "cv", 8.0),
    "builtin gnn gate 0.99": built_in("gnn", gate=0.99),
    "builtin jipda gate 0.99999": built_in("jipda", gate=0.99999),
    # Where the likelihood decides too, a gate may be as large as it likes.
    "builtin gnn, practically no gate": built_in("gnn", gate=1 - 1e-15),
    "builtin gnn 2 of 3, 0.3 s": built_in("gnn", confirm=[2, 3], delete_after_s=0.3),
    "builtin jpda 2 of 2, 0.5 s": built_in("jpda", confirm=[2, 2], delete_after_s=0.5),
    "builtin gnn 4 of 6, 1.5 s": built_in("gnn", confirm=[4, 6], delete_after_s=1.5),
    "builtin jipda no object hides": built_in("jipda", visible_s=None),
    "builtin pmb no object hides, 1.5 s": built_in("pmb", visible_s=None, delete_after_s=1.5),
    "nearest global": _own(),
    "nearest global, 2 of 2, gate 0.99": _own(confirm=(2, 2), gate=0.99),
    "nearest global, 3 of 5, gate 0.99999": _own(confirm=(3, 5), gate=0.99999, used=False),
    "nearest global, six misses": _own(misses=6),
    "nearest global, thirty misses": _own(misses=30),
    "nearest global kf": _own(filter=PlainKf, confirm=(3, 4)),
    "nearest global filterpy, lively": _own(filter=FilterPyEkf, acceleration=6.0),
    "nearest global, calm": _own(acceleration=1.0, velocity_sigma=25.0),
    "greedy score": looped(GreedyScore),
    "greedy score, quick": looped(GreedyScore, confirm=5.0, patience=0.4),
    "greedy score, slow": looped(GreedyScore, confirm=20.0, patience=1.5, gate=3.6),
    "ipda": looped(Ipda),
    "ipda, gate 0.99": looped(Ipda, gate=0.99),
    "ipda, patient": looped(Ipda, gate=0.99999, patience=1.5, confirm=0.9),
    "ipda, lively": looped(Ipda, acceleration=6.0, born=0.2),
}
#: Of these only one kind of sensor is given.
ALONE = ("builtin gnn", "builtin pmb", "nearest global", "nearest global kf", "greedy score", "ipda")

SOUND_SUBJECTS = [
    *(TrafficSubject("", "sound", name, make) for name, make in SOUND.items()),
    *(
        TrafficSubject("", "sound", f"{name}, {kind} alone", SOUND[name], (kind,))
        for name in ALONE
        for kind in ("lidar", "radar")
    ),
]
