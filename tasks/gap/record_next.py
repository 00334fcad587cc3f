"""The next motion to record: what would tell apart the effects that this recording cannot."""

from collections.abc import Sequence

MOTIONS = {
    frozenset(
        {"air", "fabric"}
    ): "the same motion at half and at twice the speed: air grows with the speed, cloth's own friction with the rate of bending",
    frozenset({"air"}): "a panel led face-on and edge-on through the air, each at two speeds",
    frozenset({"fabric"}): "a slow fold and unfold between two rests, then the same four times as fast",
    frozenset({"contact", "body"}): "a quick turn in which the cloth slips along the body, and the same pose held still for two seconds",
    frozenset({"observation", "body"}): "a jump: a late clock shows in free flight, a late body only where it touches",
    frozenset({"observation"}): "a rigid board with the garment's texture, moved fast by hand: cloth cannot explain its residual",
    frozenset({"boundary", "body"}): "the waistband marked by tape and turned quickly, then held still",
    frozenset(
        {"gravity", "air"}
    ): "the garment hanging still for two seconds, turned by 180° and still again: wind stays, a tilt turns along",
}
STILL = "a faster motion with stops: sways of 0.3 m at 1 Hz, half turns, and two seconds of rest after each"
MORE = "the same garment in a second, different motion of at least two seconds"


def record_next(kind: str, names: Sequence[str]) -> str:
    """A motion, for a verdict of this kind over these effects."""
    if kind == "not_testable":
        return STILL
    families = frozenset(n.split("_")[0] for n in names)
    for known, motion in MOTIONS.items():
        if len(names) > 1 and families <= known:
            return motion
    return MORE
