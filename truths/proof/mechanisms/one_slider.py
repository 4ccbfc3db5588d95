"""Contact of one slider with its guide, for mechanisms whose coordinate 0 is the slider's displacement along it.

n1, n2 are the normal forces at the rear and front corners, at distance a/2 from the slider's centre; R = n1 + n2 and M
are the force and the moment about the centre that the guide has to supply. Friction acts on surfaces at distance b/2,
s mu times their normal force against the slip s = sgn(x' - u), so that

    D = n2 - n1 = (2/a) (M + s mu (b/2) R) ,    N = |n1| + |n2| = max(|R|, |D|) ;

a guide without length has N = |R|. Slip with the signs (e1, e2) of n1, n2 has N = e1 n1 + e2 n2.

Rest lasts while full static friction holds the push P, all forces along the guide but friction, in both directions:
mus max(|R|, |D_s|) - s P > 0 for s = 1, -1, with D_s as above for mus. It breaks away in the direction whose margin
reaches zero, if mus b <= a (else the guide can jam instead: its surfaces press against each other as hard as it takes).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flint import arb, arb_series

from stiction.truths.proof.enclosures.arc import APriori
from stiction.truths.proof.enclosures.exact import ZERO, ExactPart
from stiction.truths.proof.enclosures.series import Value
from stiction.truths.proof.enclosures.zeros import Undecided
from stiction.truths.proof.mechanisms.mechanism import Next, ProvableMechanism

Mode = tuple[int, int, int]
"""Direction of slip (0: rest) and the signs of n1 and n2 (0, 0 at rest)."""
REST: Mode = (0, 0, 0)
SLIP = "slip"
"""Guard in slip: the speed. Guards at rest have the directions of slip as names."""
NORMAL = "normal"
"""Guard in slip: the normal force of a guide without corner forces."""
REAR = "rear"
"""Guard in slip: the corner force at the rear."""
FRONT = "front"
"""Guard in slip: the corner force at the front."""


@dataclass(frozen=True)
class Contact:
    """Dimensions and friction of a slider: a (None: no corner forces), b, mu, mus; exactly: mu = mus, and mus = 0."""

    length: Any
    width: arb
    mu: arb
    mus: arb
    one_coefficient: bool
    frictionless: bool

    @classmethod
    def of(cls, guide: ExactPart) -> Contact:
        """Return the contact of a scene's guide."""
        mu = guide.mu or ZERO
        mus = guide.mus or mu
        return cls(
            guide.length and guide.length.ball,
            (guide.width or ZERO).ball,
            mu.ball,
            mus.ball,
            mu.equals(mus),
            mus.is_zero,
        )

    def friction(self, slip: int) -> arb:
        """Return s mu."""
        return slip * self.mu

    def difference(self, R: Value, M: Value, friction: arb) -> Value:
        """Return D with s mu, or s mus, = friction."""
        return (M + R * (friction * self.width / 2)) * (2 / self.length)

    def load(self, R: Value, M: Value, mode: Mode) -> Value:
        """Return N in slip: E R + T D, with E = (e1 + e2)/2 and T = (e2 - e1)/2, of which one is zero."""
        slip, e1, e2 = mode
        if e1 == e2:
            return R * e1
        return self.difference(R, M, self.friction(slip)) * e2


@dataclass(frozen=True, kw_only=True)
class OneSlider(ProvableMechanism):
    """A mechanism with one slider on a surface of speed u, m/s; `at_rest` where x' = u exactly at t = 0."""

    contact: Contact
    surface: arb
    at_rest: bool

    @abstractmethod
    def contact_loads(
        self, t: arb_series, q: Sequence[Value], v: Sequence[Value], a: Sequence[Value]
    ) -> tuple[Value, Value, Value]:
        """Return R, M and P."""

    def guards(self, mode: Mode, t: arb_series, q, v, a):
        slip, contact = mode[0], self.contact
        R, M, P = self.contact_loads(t, q, v, a)
        if slip == 0:
            return {s: self._margins(R, M, P, s) for s in (1, -1)}
        guards = {} if contact.frictionless else {SLIP: [(v[0] - self.surface) * slip]}
        if contact.length is None:
            return guards | {NORMAL: [R * mode[1]]}
        D = contact.difference(R, M, contact.friction(slip))
        return guards | {REAR: [(R - D) * mode[1]], FRONT: [(R + D) * mode[2]]}

    def _margins(self, R: Value, M: Value, P: Value, s: int) -> list[Value]:
        """Return the functions whose largest one is mus max(|R|, |D_s|) - s P."""
        contact = self.contact
        loads = [R] if contact.length is None else [R, contact.difference(R, M, s * contact.mus)]
        return [load * (sign * contact.mus) - P * s for load in loads for sign in (1, -1)]

    @abstractmethod
    def require_unique(self, mode: Mode, t: arb, bound: APriori | None = None) -> None:
        """Prove uniqueness throughout a bound, or at an instant if there is no bound."""

    def held(self, mode: Mode) -> Mapping[int, arb]:
        return {0: self.surface} if mode[0] == 0 else {}

    def start(self) -> Next:
        zero = arb(0)
        if self.contact.frictionless:
            return Next(self._configured(1, zero, self.q, self.v))
        if self.at_rest:
            return self._from_rest(zero, self.q, self.v, False)
        relative = self.v[0] - self.surface
        if not (relative > 0 or relative < 0):
            raise Undecided("whether the slider rests at the start", zero)
        return Next(self._configured(1 if relative > 0 else -1, zero, self.q, self.v))

    def after(self, mode: Mode, guard: str | int, t: arb, q: list[arb], v: list[arb]) -> Next:
        slip, e1, e2 = mode
        if isinstance(guard, int):  # at rest they are directions
            return self._slipping(guard, t, q, v, "slip", self.contact.one_coefficient)
        if guard == SLIP:
            return self._from_rest(t, q, v, True)
        # a corner force passes zero: its sign changes, and the guard of the new sign starts at zero
        return Next(
            (slip, e1 if guard == FRONT else -e1, e2 if guard == REAR else -e2),
            {guard: 1},
            "corner",
        )

    def _from_rest(self, t: arb, q: Sequence[arb], v: Sequence[arb], moved: bool) -> Next:
        """Return the mode at velocity zero relative to the surface; raise Undecided if it is not proven."""
        v = [self.surface, *v[1:]]
        # Balls that contain zero prove neither: where it is open in one direction the mode is
        # undecided.
        margins = self.guards_at(REST, t, q, v)
        holds = {s: any(f > 0 for f in margins[s]) for s in (1, -1)}
        if all(holds.values()):
            return Next(REST, kind="stick", smooth=False)
        for s in (1, -1):
            if all(f < 0 for f in margins[s]) and holds[-s]:
                return self._slipping(s, t, q, v, "reversal" if moved else "slip", False)
        raise Undecided("whether static friction holds the slider where its velocity is zero", t)

    def _slipping(
        self, slip: int, t: arb, q: Sequence[arb], v: Sequence[arb], kind: str, smooth: bool
    ) -> Next:
        """Return the mode of slip that begins from rest.

        It is `smooth` if its acceleration is zero: with one coefficient, where a margin is zero.
        """
        if (
            self.contact.length is not None
            and not self.contact.mus * self.contact.width <= self.contact.length
        ):
            raise Undecided("a guide that breaks away could jam instead: mus * width > length", t)
        return Next(
            self._configured(slip, t, q, [self.surface, *v[1:]]),
            {SLIP: 2 if smooth else 1},
            kind,
            smooth,
        )

    def _configured(self, slip: int, t: arb, q: Sequence[arb], v: Sequence[arb]) -> Mode:
        """Return the mode of slip whose corner forces have the signs of the mode."""
        # The motion is unique, so that the first consistent configuration is the only one.
        self.require_unique((slip, 1, 1), t)
        one_surface, both_surfaces = [(1, 1), (-1, -1)], [(1, -1), (-1, 1)]
        configurations = one_surface
        if self.contact.length is not None:
            configurations = one_surface + both_surfaces
        for signs in configurations:
            mode = (slip, *signs)
            guards = self.guards_at(mode, t, q, v)
            if all(value > 0 for name in guards for value in guards[name] if name != SLIP):
                return mode
        raise Undecided(
            "a corner force that is zero, or no contact configuration, where slip begins", t
        )
