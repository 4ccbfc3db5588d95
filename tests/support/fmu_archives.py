"""FMUs that the tests build: a description, and a library that cc makes of tests/engines/fmu/slider_bar.c."""

import subprocess
import zipfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

SOURCE = Path(__file__).parents[1] / "engines" / "fmu" / "slider_bar.c"
PARAMETERS = "F0 L w0 g m1 m2 k L0 Omega mu mus".split()
OUTPUTS = (
    "bar.x bar.y bar.angle bar.vx bar.vy bar.omega bar.ax bar.ay bar.alpha slider.x slider.y slider.angle slider.vx slider.vy "
    "slider.omega slider.ax slider.ay slider.alpha guide.friction guide.mode degrees"
).split()


def library(folder, steps=False, failure=0):
    """Path of the compiled source, FMI 2 model exchange or FMI 3 co-simulation."""
    made = folder / f"library-{steps}-{failure}.so"
    if not made.exists():
        subprocess.run(
            [
                "cc",
                "-O2",
                "-w",
                "-shared",
                "-fPIC",
                f"-DFAILURE={failure}",
                *["-DSTEPS"] * steps,
                "-o",
                made,
                SOURCE,
                "-lm",
            ],
            check=True,
        )
    return made


def slider_bar(
    file,
    library,
    fmi=2,
    scene="slider-bar-*",
    names=None,
    left_out=(),
    constants=None,
    platform=None,
):
    """Write an FMU of the slider-bar; `names` renames variables, `constants` gives the values of parameters that cannot be set."""
    from fmpy import platform as own
    from fmpy import platform_tuple

    names, constants = names or {}, constants or {}
    real, ends = ("ScalarVariable", "</ScalarVariable>") if fmi == 2 else ("Float64", "")

    def variable(name, reference, attributes, start=None, unit=""):
        value = "".join(
            f" {key}={quoteattr(text)}" for key, text in (("unit", unit), ("start", start)) if text
        )
        head = f'<{real} name={quoteattr(names.get(name, name))} valueReference="{reference}" {attributes}'
        return head + (f"><Real{value}/>{ends}" if fmi == 2 else f"{value}/>")

    parts = [
        variable(
            name,
            i,
            'causality="parameter" variability="fixed"'
            if name not in constants
            else 'causality="local" variability="constant" initial="exact"',
            str(constants.get(name, 1.0)),
        )
        for i, name in enumerate(PARAMETERS)
    ]
    shift = len(PARAMETERS)
    if fmi == 2:
        parts += [
            variable("state.x", shift, 'causality="local"'),
            variable("state.v", shift + 1, 'causality="local"'),
        ]
        parts += [
            '<ScalarVariable name="der.x" valueReference="90"><Real derivative="12"/></ScalarVariable>',
            '<ScalarVariable name="der.v" valueReference="91"><Real derivative="13"/></ScalarVariable>',
        ]
    parts += [
        variable(name, shift + 2 + i, 'causality="output"', unit="deg" if name == "degrees" else "")
        for i, name in enumerate(OUTPUTS)
        if name not in left_out
    ]
    if scene and fmi == 2:
        parts.append(
            f'<ScalarVariable name="stiction.scene" valueReference="99" causality="parameter" variability="fixed"><String start="{scene}"/></ScalarVariable>'
        )
    elif scene:
        parts.append(
            f'<String name="stiction.scene" valueReference="99" causality="parameter" variability="fixed"><Start value="{scene}"/></String>'
        )
    units = '<UnitDefinitions><Unit name="deg"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit></UnitDefinitions>'
    kind = (
        '<ModelExchange modelIdentifier="slider" completedIntegratorStepNotNeeded="true"/>'
        if fmi == 2
        else '<CoSimulation modelIdentifier="slider" canHandleVariableCommunicationStepSize="true"/>'
    )
    structure = (
        '<ModelStructure><Derivatives><Unknown index="14"/><Unknown index="15"/></Derivatives></ModelStructure>'
        if fmi == 2
        else "<ModelStructure/>"
    )
    head = (
        'fmiVersion="2.0" guid="1" numberOfEventIndicators="2"'
        if fmi == 2
        else 'fmiVersion="3.0" instantiationToken="1"'
    )
    text = f'<fmiModelDescription {head} modelName="slider" version="7">{kind}{units}<ModelVariables>{"".join(parts)}</ModelVariables>{structure}</fmiModelDescription>'
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.write(
            library, f"binaries/{platform or (own if fmi == 2 else platform_tuple)}/slider.so"
        )
    return Path(file)
