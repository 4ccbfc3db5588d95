"""Contact of one slider with its guide, for the reduced solutions.

A slider of length a and width b carries the normal force R = n1 + n2, and its guide exerts the moment M about its
centre (all other moments on it, by drives and inertia, sum to -M). n1 and n2 are the normal forces at the rear and
front corners: a positive one acts at the lower surface, a negative one at the upper surface. The frictions of the
surfaces are phi N+ and phi N- along the guide, with phi = -mu s in slip and phi = rho mus in stick, the same fraction
rho on both surfaces (equal mobilization). With b/2 the lever of the surfaces,

    M = (a/2) (n2 - n1) + (b/2) phi (N+ - N-) ,    N+ - N- = n1 + n2 = R
    =>  D = n2 - n1 = (2/a) (M - (b/2) phi R) ,    N = N+ + N- = |n1| + |n2| = max(|R|, |D|) .

With the signs sigma1, sigma2 of n1, n2 known, N = sigma1 n1 + sigma2 n2 = S R + T D, S = (sigma1 + sigma2)/2,
T = (sigma2 - sigma1)/2: linear. A guide without length has N = |R|: sigma1 = sigma2.

Break-away. At rest the law lets the two surfaces differ: |f+| <= mus N+, |f-| <= mus N-. With w = f+ - f- the moment
gives D = (2/a) (M - (b/2) w) and N+ + N- = S(w) = max(|R|, |D|), N+ - N- = R. From f+ = (f + w)/2 <= mus (S + R)/2 and
f- = (f - w)/2 <= mus (S - R)/2 the largest friction f = f+ + f- is  max over w of  mus S(w) - |w - mus R|, with
|w| <= mus S(w). S changes by at most b/a per unit of w. For mus b <= a the maximum is therefore at w = mus R, full
mobilization of both surfaces. The guide breaks away at the friction mus S(mus R) (backwards with -mus R). For mus b > a
the maximum is infinite: the surfaces can press against each other by their own friction, and the guide can jam under
any load (drawer effect; Painleve's paradox of rest). A guide at rest beyond full mobilization then has two motions, jam
and slip, which `require_unique_slip` refuses; below full mobilization it rests in either case. Only for mus b > a can
fully mobilized static friction be less than kinetic friction: mu S(mu R) grows with mu as long as mu b < a, since
S >= |R| and |dS/dmu| <= (b/a) |R|.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from stiction.scenes.model import Translational
from stiction.truths.reduced.piecewise_smooth import TRIAL_STEPS, NoMotion, PiecewiseMechanism

Signs = tuple[int, int]
"""Signs of n1 and n2."""
Mode = tuple[int, Signs]
"""Direction of slip (-1, 1; 0 in stick) and signs of n1, n2, which have no effect in stick (0, 0)."""
STICK: Mode = (0, (0, 0))
"""The mode of stick."""


@dataclass(frozen=True)
class Contact:
    """Dimensions and friction of a slider.

    Attributes
    ----------
    length : float or None
        Length a, m; None for a guide without corner forces.
    width : float
        Width b, m.
    mu, mus : float
        Kinetic and static coefficients.
    frictional : bool
        False if the guide has no columns of friction.
    """

    length: float | None
    width: float
    mu: float
    mus: float
    frictional: bool = True

    @classmethod
    def of(cls, guide: Translational) -> Contact:
        """Return the contact of a scene's translational joint; without friction mu = mus = 0."""
        return cls(
            guide.length,
            guide.width or 0.0,
            guide.mu or 0.0,
            guide.static_coefficient,
            guide.frictional,
        )

    @property
    def frictionless(self) -> bool:
        """True if the guide has no friction."""
        return self.mus == 0.0

    def corners(self, R, M, phi):
        """Return n1 and n2 (N), which are R/2 for a guide without length."""
        if self.length is None:
            return R / 2, R / 2
        D = 2 / self.length * (M - self.width / 2 * phi * R)
        return (R - D) / 2, (R + D) / 2

    def load(self, R, M, phi, signs: Signs):
        """Return N = |n1| + |n2| (N) by the signs of n1 and n2, which make it linear in R and M."""
        n1, n2 = self.corners(R, M, phi)
        return signs[0] * n1 + signs[1] * n2

    def capacity(self, R, M, phi):
        """Return the friction |phi| N of a mobilization, N."""
        n1, n2 = self.corners(R, M, phi)
        return abs(phi) * (abs(n1) + abs(n2))

    def margins(self, R, M, push):
        """Return the reserve of full static friction against a push along the guide, forwards and backwards, N.

        With phi = -mus s and D_s its D, static friction holds while  mus max(|R|, |D_s|) - s push > 0  for s = 1, -1:
        the largest of the functions  +-mus R - s push  and  +-mus D_s - s push, as smooth as R, M and push. By s and
        function: shape (2, 4, k), or (2, 2, k) for a guide without length.
        """
        # The maximum of functions has kinks, where polynomials converge slowly. Therefore each function
        # is returned by itself.
        margins = []
        for s in (1, -1):
            n1, n2 = self.corners(R, M, -self.mus * s)
            loads = (R,) if self.length is None else (R, n2 - n1)
            margins.append(
                [sign * self.mus * load - s * push for load in loads for sign in (1, -1)]
            )
        return np.array(margins)

    def require_unique_slip(self, t: float) -> None:
        """Raise NoMotion if a guide at rest, loaded beyond full static friction at time t (s), can jam: mus b > a."""
        if self.length is not None and self.mus * self.width > self.length:
            raise NoMotion(
                "several motions: a guide at rest under more than full static friction holds can slip or "
                f"jam (mus * width = {self.mus * self.width:g} > length = {self.length:g})",
                t,
            )

    def mobilization(self, R, M, friction):
        """Return phi in stick, the root of  phi N(phi) = friction  with the smallest magnitude.

        |phi| N is the larger of |phi R| and |phi (p - r phi)|, p = (2/a) M, r = (b/a) R, and zero at phi = 0. It first
        reaches |friction| where the first of the two does. With u = |phi| the second is u (|p| + |r| u) if p and r phi
        differ in sign, else u ||p| - |r| u|, which rises to its first maximum, falls to zero and rises again.
        """
        force = np.abs(friction)
        with np.errstate(invalid="ignore", divide="ignore"):
            # |phi R| = |friction|
            smallest = force / np.abs(R)
            if self.length is not None:
                # Solve quadratics in u. The roots have a sum in the denominator to avoid cancellation.
                p = np.abs(2 / self.length * M)
                r = np.abs(self.width / self.length * R)
                opposed = p * p + 4 * r * force
                alike = p * p - 4 * r * force
                # u (p + r u) = force
                opposed_root = 2 * force / (p + np.sqrt(opposed))
                # u (p - r u) = force before the maximum, or u (r u - p) = force on the second rise
                alike_root = np.where(
                    alike >= 0, 2 * force / (p + np.sqrt(alike)), (p + np.sqrt(opposed)) / (2 * r)
                )
                same_sign = np.sign(friction) * M * R > 0
                # `fmin` ignores the NaN of a zero load.
                smallest = np.fmin(smallest, np.where(same_sign, alike_root, opposed_root))
        return np.where(force > 0, np.sign(friction) * smallest, 0.0)

    def columns(self, guide: str, R, M, phi, mode, **others) -> dict[str, np.ndarray]:
        """Return the columns of a guide: normal force, moment, corner and friction forces, mode, and `others`."""
        values = {"normal_force": R, "moment": M}
        n1, n2 = self.corners(R, M, phi)
        # Corners 1 and 2 are at the lower surface, and 4 and 3 opposite to them at the upper surface.
        # Only one corner of each pair presses.
        F1, F2, F3, F4 = (np.maximum(n, 0) for n in (n1, n2, -n2, -n1))
        lower = F1 + F2
        upper = F4 + F3
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
        """Return R, M and the push, which is the sum of all forces along the guide except friction; each (k,)."""

    def guards(self, t, q, v, a, mode: Mode) -> np.ndarray:
        """Return guards: slip keeps its direction and corners keep their surfaces, stick can hold the push."""
        R, M, push = self.loads(t, q, v, a)
        slip, signs = mode
        if slip == 0:
            return self.contact.margins(R, M, push)
        n1, n2 = self.contact.corners(R, M, self.slip_fraction(slip))
        corners = [signs[0] * n1, signs[1] * n2]
        return np.array(corners if self.contact.frictionless else [slip * v[0], *corners])[:, None]

    def slip_fraction(self, slip: int) -> float:
        """Return phi in slip."""
        return -self.contact.mu * slip

    def guide_columns(self, guide: str, t, q, v, a, mode: Mode, **others) -> dict[str, np.ndarray]:
        """Return the columns of the guide within a mode; in stick phi is what equilibrium needs."""
        R, M, push = self.loads(t, q, v, a)
        zero = np.zeros_like(t)
        if self.contact.frictionless:
            return self.contact.columns(guide, R, M, zero, np.sign(v[0]), **others)
        if mode[0]:
            phi = zero + self.slip_fraction(mode[0])
        else:
            phi = self.contact.mobilization(R, M, -push)
        return self.contact.columns(guide, R, M, phi, zero + mode[0], **others)

    def candidates(
        self, t: float, q: np.ndarray, v: np.ndarray, mode: Mode | None, guard: int | None
    ):
        # Signs of the corner forces, by which each corner is at one of the surfaces.
        patterns = [(1, 1), (-1, -1)]
        if self.contact.length is not None:
            patterns += [(1, -1), (-1, 1)]
        if self.contact.frictionless:
            yield [((1, signs), v) for signs in patterns]
            return
        if mode is None:
            slip = int(np.sign(v[0]))
        elif guard == 0:
            # In slip the speed has reached zero, or at rest static friction has reached its bound.
            slip = 0
        else:
            slip = mode[0]
        if slip:
            yield [((slip, signs), v) for signs in patterns]
        # A start that is so slow that it comes to rest within a trial step has no mode of slip.
        slowest = self.pace * TRIAL_STEPS[0] * self.magnitude
        if slip == 0 or (mode is None and abs(v[0]) <= slowest):
            # Rest has precedence. If it is not possible, the slider slips in the only direction in
            # which slip is consistent.
            rest = np.concatenate([[0.0], v[1:]])
            yield [(STICK, rest)]
            self.contact.require_unique_slip(t)
            yield [((slip, signs), rest) for slip in (1, -1) for signs in patterns]

    def slip(self, mode: Mode) -> tuple[int, ...]:
        return mode[:1]
