"""What a second run says about how far a result is off."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

#: What is further off, in tolerances, is not certified: the digit by which the two runs' tolerances
#: differ is lost, and how far it is off is then known to an order of magnitude only.
BOUND = 10.0
#: What to do where the second run failed.
LOOSER = "certify at a looser tolerance, with other limits or another code"


@dataclass(frozen=True, slots=True)
class ChannelError:
    """Measured error of one channel, where it is largest in tolerances.

    Attributes
    ----------
    name, unit : str
        The channel or component; ``rad`` for an orientation by Euler parameters.
    time : float
        Where it is largest, s.
    error : float
        The distance between the two runs there, in `unit`; of a vector its length; infinite where
        a row of one of them is not finite.
    tolerance : float
        The tolerance there, in `unit`.
    tolerances : float
        The error in tolerances: 1 is on tolerance; infinite where `error` is.
    """

    name: str
    unit: str
    time: float
    error: float
    tolerance: float
    tolerances: float


@dataclass(frozen=True, slots=True)
class Certification:
    """What a second run at a tenth of the tolerance, with shorter steps, says about a result.

    Attributes
    ----------
    tolerance : dict of str to float
        Of the second run: ``relative``, ``translation`` (m; m/s), ``rotation`` (rad; rad/s).
    bound : float
        A result is certified when every channel is at most so many tolerances off.
    channels : tuple of ChannelError
        The channels that the run was asked for; without any, the positions, orientations,
        velocities and angular velocities of all bodies.
    until : float or None
        Time up to which the runs were compared, s; None when the second run did not begin.
    reason : dict
        Why there is no second run that reached its end: ``code``, ``message`` and, where known,
        ``time``, ``help``, …; empty when there is.
    statistics : dict
        Counts and times of the second run.
    """

    tolerance: dict[str, float]
    bound: float = BOUND
    channels: tuple[ChannelError, ...] = ()
    until: float | None = None
    reason: dict[str, Any] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)

    @property
    def certified(self) -> bool:
        """Whether the second run reached its end and every channel is within the bound."""
        return not self.reason and not self.exceeding

    @property
    def exceeding(self) -> tuple[ChannelError, ...]:
        """The channels beyond the bound, the worst first."""
        return tuple(c for c in self.ranked if c.tolerances > self.bound)

    @property
    def ranked(self) -> tuple[ChannelError, ...]:
        """The channels by their error in tolerances, the worst first."""
        return tuple(sorted(self.channels, key=lambda c: -c.tolerances))

    @property
    def worst(self) -> ChannelError | None:
        """The channel that is furthest off, in tolerances."""
        return max(self.channels, key=lambda c: c.tolerances, default=None)

    def __repr__(self) -> str:
        said = "certified" if self.certified else "not certified"
        worst = f", {w.name} off by {w.tolerances:.3g} tolerances" if (w := self.worst) else ""
        return f"<holonom.Certification: {said}, {len(self.channels)} channels{worst}>"

    def __str__(self) -> str:
        if not self.certified:
            return self._said()
        lines = [f"certified: all channels are within {self.bound:g} tolerances"]
        lines += [f"{c.tolerances:10.3g} tolerances  {c.name}" for c in self.ranked]
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Return plain data, as a result file stores it; what is infinite is None."""
        channels = [
            {f: None if (value := getattr(c, f)) == math.inf else value for f in c.__slots__}
            for c in self.channels
        ]
        data = {f: getattr(self, f) for f in Certification.__slots__}
        return {"certified": self.certified, **data, "channels": channels}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Certification:
        """Read what `to_json` returns."""
        known = {f: data[f] for f in cls.__slots__ if f in data}
        return cls(**known | {"channels": tuple(map(_channel, data["channels"]))})

    def continued(self, time: float) -> Certification:
        """Return what it says of a result that goes on from a time (s) without a second run."""
        if self.reason or self.exceeding:
            return self
        beyond = time if self.until is None else min(time, self.until)
        message = f"there was no second run beyond {beyond:.6g} s, where the result was continued"
        tip = "certify a run of the whole time"
        reason = {"code": "simulation/not-certified", "message": message, "advice": tip}
        return replace(self, reason=reason)

    def warning(self) -> dict[str, str] | None:
        """Return the warning of a result that is not certified: ``code``, ``message``, ``path``."""
        if self.certified:
            return None
        return {"code": "simulation/not-certified", "message": self._said(), "path": ""}

    def _said(self) -> str:
        if self.reason:
            text = f"not certified, but kept: {self.reason['message']} ({self.reason['code']})"
            if self.until is not None and (worst := self.worst) is not None:
                text += f"; up to {self.until:.6g} s `{worst.name}` is furthest off"
                text += f", {worst.tolerances:.3g} tolerances"
            return f"{text}: {self.reason.get('advice') or LOOSER}"
        worst, others = self.exceeding[0], len(self.exceeding) - 1
        text = (
            f"not certified: `{worst.name}` is {worst.tolerances:.3g} tolerances off the run at "
            f"a tenth of the tolerance, {f'{worst.error:.1e} {worst.unit}'.rstrip()} at "
            f"{worst.time:.6g} s"
        )
        if others:
            text += f"; {others} more of {len(self.channels)} channels " + (
                "is" if others == 1 else "are"
            )
            text += f" more than {self.bound:g} off"
        return (
            f"{text}: tighten the tolerance to {self.tolerance['relative']:g} or further and "
            "certify that, or compare with another code"
        )


def _channel(data: Mapping[str, Any]) -> ChannelError:
    """Read what `Certification.to_json` says of a channel."""
    found: dict[str, Any] = {f: math.inf if v is None else v for f, v in data.items()}
    # NaN, or −1, is what older files say of rows that are not finite.
    if not found["tolerances"] >= 0.0:
        found |= {"error": math.inf, "tolerances": math.inf}
    return ChannelError(**found)
