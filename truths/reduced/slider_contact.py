"""The contact of one slider with its guide, for the reduced solutions.

A slider of length a and width b carries the normal force R = n1 + n2 and needs the moment M about its centre from its
guide (whatever else turns it, drive or inertia, has the moment -M). n1 and n2 are the normal forces at the rear and
front corners. The lower surface takes each where it is positive, the upper where it is negative. The friction of the
surfaces is phi N+ and phi N- along the guide, with phi = -mu s in slip and phi = rho mus in stick, the same fraction
rho on both surfaces (equal mobilization). With b/2 the lever of the surfaces,

    M = (a/2) (n2 - n1) + (b/2) phi (N+ - N-) ,    N+ - N- = n1 + n2 = R
    =>  D = n2 - n1 = (2/a) (M - (b/2) phi R) ,    N = N+ + N- = |n1| + |n2| = max(|R|, |D|) .

With the signs sigma1, sigma2 of n1, n2 known, N = sigma1 n1 + sigma2 n2 = S R + T D, S = (sigma1 + sigma2)/2,
T = (sigma2 - sigma1)/2: linear. A guide without length has N = |R|: sigma1 = sigma2.

Break-away. At rest the law lets the two surfaces differ: |f+| <= mus N+, |f-| <= mus N-. With w = f+ - f- the moment
gives D = (2/a) (M - (b/2) w) and N+ + N- = S(w) = max(|R|, |D|), N+ - N- = R. From f+ = (f + w)/2 <= mus (S + R)/2 and
f- = (f - w)/2 <= mus (S - R)/2 the largest friction f = f+ + f- is  max over w of  mus S(w) - |w - mus R|, with
|w| <= mus S(w). S changes by at most b/a per unit of w. For mus b <= a the maximum is therefore at w = mus R, full
mobilization of both surfaces: that is the rule of break-away, mus S(mus R) (with -mus R backwards). For mus b > a it
is infinite: the surfaces can press against each other by their own friction as hard as it takes, and the guide can jam
under any load (drawer effect; Painleve's paradox of rest). A guide at rest beyond full mobilization then has two
motions, jam and slip, and `require_unique_slip` refuses; within it rests in either case. Only there can static
friction, fully mobilized, be less than kinetic: mu S(mu R) grows with mu as long as mu b < a, since S >= |R| and
|dS/dmu| <= (b/a) |R|.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from stiction.scenes.model import Translational
from stiction.truths.reduced.piecewise_smooth import TRIAL_STEPS, NoMotion, PiecewiseMechanism

Signs = tuple[int, int]
Mode = tuple[int, Signs]
"""Direction of slip (-1, 1; 0: stick) and signs of n1, n2, which nothing depends on in stick (0, 0)."""
STICK: Mode = (0, (0, 0))


@dataclass(frozen=True)
class Contact:
    """Dimensions and friction of a slider.

    Without a length there are no corner forces, without declared friction no columns of it.
    """

    length: float | None
    width: float
    mu: float
    mus: float
    frictional: bool = True

    @classmethod
    def of(cls, guide: Translational) -> Contact:
        """The contact of a scene's translational joint; without friction mu = mus = 0."""
        return cls(
            guide.length,
            guide.width or 0.0,
            guide.mu or 0.0,
            guide.static_coefficient,
            guide.frictional,
        )

    @property
    def frictionless(self) -> bool:
        return self.mus == 0.0

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

    def capacity(self, R, M, phi):
        """The friction |phi| N of a given mobilization, N."""
        n1, n2 = self.corners(R, M, phi)
        return abs(phi) * (abs(n1) + abs(n2))

    def margins(self, R, M, push):
        """Return the reserve of full static friction against a push along the guide, forwards and backwards, N.

        With phi = -mus s and D_s its D, static friction holds while  mus max(|R|, |D_s|) - s push > 0  for s = 1, -1:
        the largest of the functions  +-mus R - s push  and  +-mus D_s - s push, as smooth as R, M and push. By s and
        function: shape (2, 4, k), or (2, 2, k) for a guide without length.
        """
        # A maximum of functions has kinks, on which polynomials converge slowly: each function is
        # returned by itself.
        margins = []
        for s in (1, -1):
            n1, n2 = self.corners(R, M, -self.mus * s)
            loads = (R,) if self.length is None else (R, n2 - n1)
            margins.append(
                [sign * self.mus * load - s * push for load in loads for sign in (1, -1)]
            )
        return np.array(margins)

    def require_unique_slip(self, t: float) -> None:
        """Raise NoMotion where a guide at rest, loaded beyond full static friction at time t, can jam: mus b > a."""
        if self.length is not None and self.mus * self.width > self.length:
            raise NoMotion(
                "several motions: a guide at rest under more than full static friction holds can slip or "
                f"jam (mus * width = {self.mus * self.width:g} > length = {self.length:g})",
                t,
            )

    def mobilization(self, R, M, friction):
        """Return phi in stick: of the roots of  phi N(phi) = friction  the smallest.

        |phi| N is the larger of |phi R| and |phi (p - r phi)|, p = (2/a) M, r = (b/a) R, and zero at phi = 0. It first
        reaches |friction| where the first of the two does. With u = |phi| the second is u (|p| + |r| u) if p and r phi
        differ in sign, else u ||p| - |r| u|, which rises to its first maximum, falls to zero and rises again.
        """
        force = np.abs(friction)
        with np.errstate(invalid="ignore", divide="ignore"):
            # |phi R| = |friction|
            smallest = force / np.abs(R)
            if self.length is not None:
                # Quadratics in u. Roots are written with a sum in the denominator: nothing cancels.
                p, r = np.abs(2 / self.length * M), np.abs(self.width / self.length * R)
                opposed, alike = p * p + 4 * r * force, p * p - 4 * r * force
                # u (p + r u) = force
                opposed_root = 2 * force / (p + np.sqrt(opposed))
                # u (p - r u) = force before the maximum, else u (r u - p) = force on the second
                # rise
                alike_root = np.where(
                    alike >= 0, 2 * force / (p + np.sqrt(alike)), (p + np.sqrt(opposed)) / (2 * r)
                )
                same_sign = np.sign(friction) * M * R > 0
                # `fmin` ignores the NaN of a load that is zero
                smallest = np.fmin(smallest, np.where(same_sign, alike_root, opposed_root))
        return np.where(force > 0, np.sign(friction) * smallest, 0.0)

    def columns(self, guide: str, R, M, phi, mode, **others) -> dict[str, np.ndarray]:
        """Return the columns of a guide: normal force, moment, corner and friction forces, mode, and others."""
        values = {"normal_force": R, "moment": M}
        n1, n2 = self.corners(R, M, phi)
        # corners 1 and 2 are those of the lower surface, 4 and 3 the same of the upper one: only
        # one of each pair presses
        F1, F2, F3, F4 = (np.maximum(n, 0) for n in (n1, n2, -n2, -n1))
        lower, upper = F1 + F2, F4 + F3
        if self.length is not None:
            values |= {"F1": F1, "F2": F2, "F3": F3, "F4": F4}
        if self.frictional:
            values["friction"] = phi * (lower + upper)
            if self.length is not None:
                values |= {"friction_lower": phi * lower, "friction_upper": phi * upper}
            values["mode"] = mode
        return {f"{guide}.{column}": value for column, value in (values | others).items()}


class SingleSlider(PiecewiseMechanism):
    """A mechanism whose coordinate 0 is the displacement of its one slider along the guide."""

    contact: Contact

    @abstractmethod
    def loads(self, t, q, v, a):
        """R, M and the push, the sum of all forces along the guide but friction; each (k,)."""

    def guards(self, t, q, v, a, mode: Mode) -> np.ndarray:
        """Slip keeps its direction and the corners their surfaces; stick holds the push."""
        R, M, push = self.loads(t, q, v, a)
        slip, signs = mode
        if slip == 0:
            return self.contact.margins(R, M, push)
        n1, n2 = self.contact.corners(R, M, self.slip_fraction(slip))
        corners = [signs[0] * n1, signs[1] * n2]
        return np.array(corners if self.contact.frictionless else [slip * v[0], *corners])[:, None]

    def slip_fraction(self, slip: int) -> float:
        """phi in slip."""
        return -self.contact.mu * slip

    def guide_columns(self, guide: str, t, q, v, a, mode: Mode, **others) -> dict[str, np.ndarray]:
        """Return the columns of the guide within a mode; in stick phi is what equilibrium needs."""
        R, M, push = self.loads(t, q, v, a)
        zero = np.zeros_like(t)
        if self.contact.frictionless:
            return self.contact.columns(guide, R, M, zero, np.sign(v[0]), **others)
        phi = (
            zero + self.slip_fraction(mode[0])
            if mode[0]
            else self.contact.mobilization(R, M, -push)
        )
        return self.contact.columns(guide, R, M, phi, zero + mode[0], **others)

    def candidates(
        self, t: float, q: np.ndarray, v: np.ndarray, mode: Mode | None, guard: int | None
    ):
        # which surface each corner rests on
        patterns = [(1, 1), (-1, -1), *([] if self.contact.length is None else [(1, -1), (-1, 1)])]
        if self.contact.frictionless:
            yield [((1, signs), v) for signs in patterns]
            return
        if mode is None:
            slip = int(np.sign(v[0]))
        elif guard == 0:
            # the speed has reached zero in slip, or static friction its bound at rest
            slip = 0
        else:
            slip = mode[0]
        if slip:
            yield [((slip, signs), v) for signs in patterns]
        # a start so slow that it is at rest within a trial step has no mode of its own
        slowest = self.pace * TRIAL_STEPS[0] * self.magnitude
        if slip == 0 or mode is None and abs(v[0]) <= slowest:
            # Rest first: it has precedence where it holds. A slider that it does not hold slips to
            # the one side where the slip is consistent.
            rest = np.concatenate([[0.0], v[1:]])
            yield [(STICK, rest)]
            self.contact.require_unique_slip(t)
            yield [((slip, signs), rest) for slip in (1, -1) for signs in patterns]

    def slip(self, mode: Mode) -> tuple[int, ...]:
        return mode[:1]
