"""The slider-bar of the catalogue stepped as in slider_bar.c, as a co-simulation FMU by pythonfmu."""

from math import copysign, cos, pi, sin

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real, String

PARAMETERS = {
    "F0": 3.0,
    "L": 2.0,
    "w0": pi / 4,
    "g": 9.81,
    "m1": 2.0,
    "m2": 1.0,
    "k": 1.0,
    "L0": 0.25,
    "Omega": pi / 2,
    "mu": 0.03,
    "mus": 0.04,
}
LENGTH, WIDTH = 0.6, 0.5


class SliderBar(Fmi2Slave):
    author = "stiction"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.scenes = "slider-bar-case-?"
        self.register_variable(
            String(
                "stiction.scene",
                causality=Fmi2Causality.parameter,
                variability=Fmi2Variability.fixed,
                getter=lambda: self.scenes,
                setter=lambda value: None,
            )
        )
        for name, value in PARAMETERS.items():
            setattr(self, name, value)
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
            )
        for place, name in enumerate(
            "bar.x bar.y bar.angle bar.vx bar.vy bar.omega bar.ax bar.ay bar.alpha slider.x slider.y slider.angle slider.vx "
            "slider.vy slider.omega slider.ax slider.ay slider.alpha guide.friction guide.mode".split()
        ):
            self.register_variable(
                Real(
                    name, causality=Fmi2Causality.output, getter=lambda place=place: self.out[place]
                )
            )
        self.t = self.v = 0.0
        self.x, self.out = self.L0, [0.0] * 20

    def exit_initialization_mode(self):
        self.x = self.L0
        self.out = self.columns()

    @property
    def mass(self):
        return self.m1 + self.m2

    def push(self):
        return (
            self.F0 * sin(self.Omega * self.t)
            - self.k * (self.x - self.L0)
            + self.m1 * self.L / 2 * self.w0**2 * cos(self.w0 * self.t)
        )

    def load(self, a, phi):
        th, c = self.w0 * self.t, self.m1 * self.L / 2
        R = self.mass * self.g - c * self.w0**2 * sin(th)
        return max(
            abs(R), 2 / LENGTH * abs(c * (self.g * cos(th) - a * sin(th)) - WIDTH / 2 * phi * R)
        )

    def slipping(self, phi):
        a = 0.0
        for _ in range(30):  # contracts: mu |B| < m
            a = (self.push() + phi * self.load(a, phi)) / self.mass
        return a

    def columns(self):
        th, r, w = self.w0 * self.t, self.L / 2, self.w0
        push = self.push()
        held = self.v == 0 and abs(push) <= self.mus * self.load(0.0, -copysign(self.mus, push))
        sign = 0.0 if held else copysign(1.0, self.v or push)
        a = 0.0 if held else self.slipping(-self.mu * sign)
        friction = -push if held else -self.mu * sign * self.load(a, -self.mu * sign)
        C, S = cos(th), sin(th)
        return [
            self.x + r * C,
            r * S,
            th,
            self.v - r * w * S,
            r * w * C,
            w,
            a - r * w * w * C,
            -r * w * w * S,
            0.0,
            self.x,
            0.0,
            0.0,
            self.v,
            0.0,
            0.0,
            a,
            0.0,
            0.0,
            friction,
            sign,
        ]

    def do_step(self, current_time, step_size):
        h, v = step_size, self.v
        self.t, self.x = current_time + h / 2, self.x + h / 2 * v
        held = -self.mass * v / h - self.push()
        most = self.mu if v else self.mus
        stays = abs(held) <= most * self.load(-v / h, copysign(most, held))
        self.v = 0.0 if stays else v + h * self.slipping(copysign(self.mu, held))
        self.t, self.x = current_time + h, self.x + h / 2 * self.v
        self.out = self.columns()
        return True
