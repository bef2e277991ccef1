"""What may happen to a rig: it is unstable, it touches, its current exceeds the bias."""

from __future__ import annotations

from rotorid.core.errors import InputError


class RigError(InputError):
    """A rig that cannot run on: what happened, when, and where.

    Parameters
    ----------
    found, expected, cure : str
        As for `InputError`.
    file, place : str, optional
    time : float or None
        Time in s since the rig was switched on, where it has one.
    where : str
        The axis.
    """

    def __init__(
        self,
        found: str,
        expected: str,
        cure: str,
        *,
        file: str = "",
        place: str = "",
        time: float | None = None,
        where: str = "",
    ) -> None:
        self.time, self.where = time, where
        super().__init__(found, expected, cure, file=file, place=place)

    def at(self, *, file: str = "", place: str = "") -> RigError:
        """Return the same error with the file and the outer place that the caller knows."""
        found = super().at(file=file, place=place)
        found.time, found.where = self.time, self.where
        return found


def touched(where: str, time: float, clearance: float) -> RigError:
    """Return the error of a rotor that touches its auxiliary bearing."""
    return RigError(
        f"the rotor touching the auxiliary bearing at {where}, {time:.6g} s after switching on",
        f"a displacement below the clearance of {clearance * 1e6:.4g} um",
        "lower the excitation or the unbalance, or stiffen the controller",
        time=time,
        where=where,
    )


def beyond_bias(where: str, time: float, current: float, bias: float) -> RigError:
    """Return the error of a current beyond the bias, where one magnet would have to push."""
    return RigError(
        f"a current of {current:.4g} A at {where}, {time:.6g} s after switching on",
        f"less than the bias of {bias:.4g} A",
        "raise the bias, lower the excitation, or limit the current",
        time=time,
        where=where,
    )


def stuck(time: float, tolerance: float) -> RigError:
    """Return the error of an integration that finds no step small enough."""
    return RigError(
        f"no step small enough, {time:.6g} s after switching on",
        f"motion that can be followed to {tolerance:g}",
        "check the parameters, or allow a larger tolerance",
        time=time,
    )


def unstable(where: str, speed: float, frequency: float, growth: float) -> RigError:
    """Return the error of an unstable closed loop; growth is its rate in 1/s."""
    return RigError(
        f"an unstable loop at {speed:.6g} rad/s: from the first instant it grows by a factor of "
        f"e every {1 / growth if growth > 0 else float('inf'):.3g} s with {frequency:.4g} Hz, "
        f"most of all at {where}",
        "a loop whose free motion decays",
        "check the sign and the size of the gains against k_i and k_s, add damping, or shorten "
        "the delay",
        time=0.0,
        where=where,
    )


def check(part: object, *, positive: tuple[str, ...] = (), zero: tuple[str, ...] = ()) -> None:
    """Refuse values that are not positive, or negative, where they must not be."""
    for names, strict in ((positive, True), (zero, False)):
        for name in names:
            value = getattr(part, name)
            if value is None or value > 0 or (value == 0 and not strict):
                continue
            raise InputError(
                f"{name} = {value}",
                "more than 0" if strict else "0 or more",
                f"give a {'positive ' if strict else ''}size, without a sign",
                place=name,
            )
