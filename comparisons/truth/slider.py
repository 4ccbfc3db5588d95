"""The contact of one slider with its guide, for the reduced solutions.

A slider of length a and width b carries the normal force R = n1 + n2 and needs the moment M about its centre
from its guide (whatever else turns it, drive or inertia, has the moment -M). n1 and n2 are the normal forces at the
rear and front corners, each taken by the lower surface where positive and by the upper where negative. The
friction of the surfaces is phi N+ and phi N- along the guide, with phi = -mu s in slip and phi = rho mus in stick, the
same fraction rho on both surfaces (equal mobilization). With b/2 the lever of the surfaces,

    M = (a/2) (n2 - n1) + (b/2) phi (N+ - N-) ,    N+ - N- = n1 + n2 = R
    =>  D = n2 - n1 = (2/a) (M - (b/2) phi R) ,    N = N+ + N- = |n1| + |n2| = max(|R|, |D|) .

With the signs sigma1, sigma2 of n1, n2 known, N = sigma1 n1 + sigma2 n2 = S R + T D, S = (sigma1 + sigma2)/2,
T = (sigma2 - sigma1)/2: linear. A guide without length has N = |R|: sigma1 = sigma2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from comparisons.truth.piecewise import PiecewiseMechanism
from scenes.model import Translational

Signs = tuple[int, int]
Mode = tuple[int, Signs]
"""Direction of slip (-1, 1; 0: stick) and signs of n1, n2."""


@dataclass(frozen=True)
class Contact:
    """Dimensions and friction of a slider; `length` None: no corner forces."""

    length: float | None
    width: float
    mu: float
    mus: float

    @classmethod
    def of(cls, guide: Translational) -> Contact:
        """The contact of a scene's translational joint; without friction mu = mus = 0."""
        return cls(guide.length, guide.width or 0.0, guide.mu or 0.0, guide.static_coefficient)

    @property
    def frictionless(self) -> bool:
        return self.mus == 0.0

    def sign_patterns(self) -> list[Signs]:
        """The contact configurations: which surface each corner rests on."""
        if self.length is None:
            return [(1, 1), (-1, -1)]
        return [(1, 1), (-1, -1), (1, -1), (-1, 1)]

    def corners(self, R, M, phi):
        """n1 and n2 (for a guide without length R/2 each)."""
        if self.length is None:
            return R / 2, R / 2
        D = 2 / self.length * (M - self.width / 2 * phi * R)
        return (R - D) / 2, (R + D) / 2

    def load(self, R, M, phi, signs: Signs):
        """N = |n1| + |n2| by the signs of a configuration; linear in R and M."""
        n1, n2 = self.corners(R, M, phi)
        return signs[0] * n1 + signs[1] * n2

    def mobilization(self, R, M, friction, signs: Signs):
        """phi in stick: the root of phi N(phi) = friction that is continuous with phi = 0.

        With sigma1 = sigma2, phi = friction / (S R). Else phi (p - r phi) = friction with p = (2/a) T M and
        r = (b/a) T R; it increases with |phi| up to mus as long as mus b < a.
        """
        if signs[0] == signs[1]:
            return friction / (signs[0] * R)
        T = (signs[1] - signs[0]) / 2
        p, r = 2 / self.length * T * M, self.width / self.length * T * R
        with np.errstate(invalid="ignore"):  # beyond break-away there may be no root: not finite
            return 2 * friction / (p + np.copysign(np.sqrt(p * p - 4 * r * friction), p))

    def mobilization_without_moment(self, R, friction):
        """phi for which friction = phi N(phi) where M = 0: N = |R| max(1, |phi| b/a)."""
        phi = friction / np.abs(R)
        lever = self.width / self.length if self.length else 0.0
        return np.where(lever * np.abs(phi) <= 1, phi, np.sign(phi) * np.sqrt(np.abs(phi) / (lever or 1.0)))

    def columns(self, R, M, phi) -> dict[str, np.ndarray]:
        """Columns of the guide: normal force, moment, corner forces and surface frictions."""
        values = {"normal_force": R, "moment": M}
        n1, n2 = self.corners(R, M, phi)
        lower, upper = np.maximum(n1, 0) + np.maximum(n2, 0), np.maximum(-n1, 0) + np.maximum(-n2, 0)
        if self.length is not None:
            values |= {"F1": np.maximum(n1, 0), "F2": np.maximum(n2, 0),
                       "F3": np.maximum(-n2, 0), "F4": np.maximum(-n1, 0)}
        values["friction"] = phi * (lower + upper)
        if self.length is not None:
            values |= {"friction_lower": phi * lower, "friction_upper": phi * upper}
        return values


class SingleSlider(PiecewiseMechanism):
    """A mechanism whose coordinate 0 is the displacement of its one slider along the guide."""

    contact: Contact

    def contact_guards(self, v, R, M, phi, mode: Mode) -> np.ndarray:
        """Slip keeps its direction or stick its friction below the limit, and the corners their surfaces."""
        slip, signs = mode
        n1, n2 = self.contact.corners(R, M, phi)
        corners = [signs[0] * n1, signs[1] * n2]
        if self.contact.frictionless:
            return np.array(corners)
        return np.array(([slip * v[0]] if slip else [self.contact.mus + phi, self.contact.mus - phi]) + corners)

    def candidates(self, t: float, q: np.ndarray, v: np.ndarray, mode: Mode | None, guard: int | None):
        patterns = self.contact.sign_patterns()
        if self.contact.frictionless:
            return [[((1, signs), v) for signs in patterns]]
        if v[0] == 0 if mode is None else mode[0] == 0 or guard == 0:
            rest = np.concatenate([[0.0], v[1:]])
            return [[((0, signs), rest) for signs in patterns],
                    [((slip, signs), rest) for slip in (1, -1) for signs in patterns]]
        slip = int(np.sign(v[0])) if mode is None else mode[0]
        return [[((slip, signs), v) for signs in patterns]]

    def slip(self, mode: Mode) -> tuple[int, ...]:
        return mode[:1]
