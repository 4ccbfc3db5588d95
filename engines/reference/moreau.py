"""Adapter of the suite's own implementation of Moreau's time stepping, at contact fidelity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.joint_effects import ALL_EFFECTS, EFFECTS_OF_GAPS, JointEffect
from stiction.engines.protocol import Capabilities, Engine, installed_version
from stiction.engines.reference.engine import compile_kernels
from stiction.engines.shared.contact_geometry import static_coefficient_refusal
from stiction.engines.shared.fixed_step import settings_of, step_of, steps_between_outputs
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity

SETTINGS = {"clearance": 1e-6}
"""Default of the setting. The clearance is far below the size of motions, and far above rounding."""


class MoreauEngine(Engine):
    """Moreau's time-stepping scheme for planar sliders, after Flores, Leine & Glocker (2010).

    It has unilateral contacts at the corners of the sliders, and a fixed step that is formulated in impulses
    (`stiction.reference_impl.integration.moreau`). If a guide has no length, the point of its slider is in contact with
    two surfaces, and its angle is fixed by a constraint.

    Guides have the clearance and Newton's coefficient of restitution that the scene declares. The method has no
    bilateral guides, so a guide without a declared clearance gets a small one, by the setting `clearance`: the distance
    between a centred slider and each surface, relative to the size of the mechanism (`Arrays.length_scale`). The
    settings of a trajectory also contain the gap of each guide in metres, ``gaps [m]``.

    Scenes are refused only for static friction above the kinetic one; guides may be on moving bodies. If
    Lemke's method finds no solution of the complementarity problem of a step, all contact modes are tried. The run ends
    early if none of them is a solution, or if there are too many to try.
    """

    name = "moreau"
    capabilities = Capabilities(
        fidelities=(Fidelity.CONTACT,),
        static_coefficient={Fidelity.CONTACT: False},
        friction_law={
            Fidelity.CONTACT: "Coulomb, set-valued, one coefficient mu, at each corner that touches (engine)"
        },
        reactions="engine",
        order="1",
        joint_effects={
            Fidelity.CONTACT: (ALL_EFFECTS | EFFECTS_OF_GAPS)
            - {
                JointEffect.STATIC_FRICTION,
                JointEffect.SPEED_DEPENDENCE,
                JointEffect.PIN_UNDER_LOAD,
            }
        },
    )

    @property
    def version(self) -> str:
        return installed_version("stiction")

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return dict(SETTINGS)

    def prepare(self) -> None:
        compile_kernels("moreau")

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return True

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        return static_coefficient_refusal(scene, "Moreau's impact law has")

    def run(
        self,
        scene: Scene,
        *,
        t_end: float,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        output_step: float,
        settings: Mapping[str, Any],
        assembly: Assembly | None = None,
    ) -> Trajectory:
        from stiction.reference_impl.compiled.kernel import clock, compiling_seconds
        from stiction.reference_impl.integration.moreau import simulate_moreau
        from stiction.reference_impl.multibody.initial_state import consistent_start

        dt = step_of(dt, t_end)
        options = settings_of(settings, SETTINGS, self.name, fidelity)
        if not 0 < options["clearance"] < 1:
            raise InputError(
                f"clearance: found {options['clearance']!r}; expected a part of the mechanism's size, 0 < "
                "clearance < 1"
            )
        compiled = compiling_seconds()
        begin = clock()
        mechanism = assembly_of(scene, assembly).whole
        q, v = consistent_start(mechanism)
        # All steps up to t_end have the same length.
        steps = max(1, round(t_end / dt))
        dt = t_end / steps
        # In metres, as the method has no scale of its own: a mechanism of another size, but the same
        # shape, gets the same motion.
        clearance = options["clearance"] * mechanism.arrays.length_scale
        assembly_s = clock() - begin
        run = simulate_moreau(
            mechanism,
            q,
            v,
            dt,
            steps,
            steps_between_outputs(steps, output_step / dt),
            clearance,
        )
        # Kernels may be compiled at their first call anywhere above, which the compiler counts.
        cost = replace(
            run.cost,
            setup_s=run.cost.setup_s + assembly_s,
            compile_s=compiling_seconds() - compiled,
        )
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=run.t,
            columns=run.columns,
            cost=cost,
            termination=run.termination,
            breakdown=run.breakdown,
            settings={
                "dt": dt,
                "method": "Moreau midpoint",
                **options,
                "gaps [m]": {
                    name: guide.clearance or clearance for name, guide in scene.guides.items()
                },
                "friction_law": self.capabilities.friction_law[fidelity],
            },
        )
