"""A Universal Scene Description [@openusd]: the panel in mm with a UsdPreviewSurface, as text."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impasto.export.folder import export_folder
from impasto.export.loss import REPORT, LossReport, measure, written
from impasto.export.mesh import Grid, panel, relief
from impasto.export.panel_textures import (
    COLOUR,
    FOLDER,
    KEPT,
    LOST,
    NORMAL,
    ROUGHNESS,
    SHINE,
    shown_by,
    write_textures,
)
from impasto.export.source import Source
from impasto.io.files import atomic_bytes

SCENE = "painting.usda"


def export_usd(source: Source, out: Path, *, displaced: bool = False) -> LossReport:
    """Write a folder with ``painting.usda`` and its textures.

    Parameters
    ----------
    source
        The painting; without the width of a pixel it is 1 mm per pixel.
    out
        The folder.
    displaced
        A mesh that follows the painting's height instead of a flat panel.
    """
    grid = relief(source) if displaced else panel(source)
    with export_folder(out) as folder:
        write_textures(source, folder, relative=False)
        _write(folder, source, grid, "")
        files = [path for path in folder.rglob("*") if path.is_file()]
        colours = measure(source, shown_by(folder, None), oblique=True)
        kept = KEPT if source.pitch_mm else KEPT[:1]
        report = LossReport("USD", kept, LOST, files=written(files, folder), **colours)
        _write(folder, source, grid, json.dumps(report.summary))
        report.save(folder / REPORT)
    return report


def _write(folder: Path, source: Source, grid: Grid, loss: str) -> None:
    # Identifiers of USD are those of Unicode, as Python's are.
    name = "".join(one if f"_{one}".isidentifier() else "_" for one in source.name) or "painting"
    name = name if name.isidentifier() else f"_{name}"
    custom = f"\n    customLayerData = {{\n        string loss = {loss}\n    }}" if loss else ""
    text = TEXT.format(
        custom=custom,
        name=name,
        count=len(grid.triangles),
        counts=_numbers(np.full(len(grid.triangles), 3)),
        indices=_numbers(grid.triangles.reshape(-1)),
        points=_tuples(grid.points),
        # USD has the origin of a picture in its lower left corner.
        places=_tuples(np.stack([grid.texture[:, 0], 1.0 - grid.texture[:, 1]], axis=1)),
        low=_tuples(grid.points.min(axis=0)[None]),
        high=_tuples(grid.points.max(axis=0)[None]),
        folder=FOLDER,
        colour=COLOUR,
        shine=SHINE,
        roughness=ROUGHNESS,
        normal=NORMAL,
    )
    atomic_bytes(folder / SCENE, text.encode("utf-8"))


def _numbers(values: NDArray[np.generic]) -> str:
    return ", ".join(map(str, values.tolist()))


def _tuples(values: NDArray[np.floating]) -> str:
    return ", ".join(f"({', '.join(f'{one:.7g}' for one in row)})" for row in values.tolist())


TEXT = """#usda 1.0
(
    defaultPrim = "{name}"
    doc = "A painting measured by impasto: x right, y up, z towards the viewer, in mm."
    metersPerUnit = 0.001
    upAxis = "Y"{custom}
)

def Xform "{name}" (
    kind = "component"
)
{{
    def Mesh "Panel" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform bool doubleSided = 0
        float3[] extent = [{low}, {high}]
        int[] faceVertexCounts = [{counts}]
        int[] faceVertexIndices = [{indices}]
        rel material:binding = </{name}/Paint>
        point3f[] points = [{points}]
        texCoord2f[] primvars:st = [{places}] (
            interpolation = "vertex"
        )
        normal3f[] normals = [(0, 0, 1)] (
            interpolation = "constant"
        )
        uniform token subdivisionScheme = "none"
    }}

    def Material "Paint"
    {{
        token outputs:surface.connect = </{name}/Paint/Surface.outputs:surface>

        def Shader "Surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </{name}/Paint/Colour.outputs:rgb>
            normal3f inputs:normal.connect = </{name}/Paint/Normal.outputs:rgb>
            float inputs:roughness.connect = </{name}/Paint/Roughness.outputs:r>
            color3f inputs:specularColor.connect = </{name}/Paint/Highlight.outputs:rgb>
            int inputs:useSpecularWorkflow = 1
            token outputs:surface
        }}

        def Shader "Places"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}

        def Shader "Colour"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./{folder}/{colour}@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </{name}/Paint/Places.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }}

        def Shader "Highlight"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./{folder}/{shine}@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </{name}/Paint/Places.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }}

        def Shader "Roughness"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./{folder}/{roughness}@
            token inputs:sourceColorSpace = "raw"
            float2 inputs:st.connect = </{name}/Paint/Places.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float outputs:r
        }}

        def Shader "Normal"
        {{
            uniform token info:id = "UsdUVTexture"
            float4 inputs:bias = (-1, -1, -1, 0)
            asset inputs:file = @./{folder}/{normal}@
            float4 inputs:scale = (2, 2, 2, 1)
            token inputs:sourceColorSpace = "raw"
            float2 inputs:st.connect = </{name}/Paint/Places.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }}
    }}
}}
"""
