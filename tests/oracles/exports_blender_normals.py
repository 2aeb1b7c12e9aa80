"""Blender's side of ``exports.py``: a normal map on a plane, under a lamp from each side.

    blender -b --factory-startup --python exports_blender_normals.py -- MAP.png FOLDER WIDTH HEIGHT

Writes ``left.exr``, ``right.exr``, ``above.exr`` and ``below.exr``: a white matte plane as the map
tilts it, under a sun at 30 degrees above the plane in whose full light a white board is 1. The map
is data ("Non-Color") in tangent space, as Blender has it by default; one pixel of a picture is one
of the map.
"""

import math
import sys
from pathlib import Path

import bpy
import mathutils

picture, folder, width, height = sys.argv[-4:]
columns, rows = int(width), int(height)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_plane_add(size=1.0)
plane = bpy.context.object
plane.scale = (columns / rows, 1.0, 1.0)
# A scale of the object would scale slopes, too.
bpy.ops.object.transform_apply(scale=True)
material = bpy.data.materials.new("paint")
material.use_nodes = True
nodes, links = material.node_tree.nodes, material.node_tree.links
nodes.clear()
image = nodes.new("ShaderNodeTexImage")
image.image = bpy.data.images.load(str(Path(picture).resolve()))
image.image.colorspace_settings.name = "Non-Color"
image.interpolation = "Closest"
tilt = nodes.new("ShaderNodeNormalMap")
paint = nodes.new("ShaderNodeBsdfDiffuse")
paint.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
out = nodes.new("ShaderNodeOutputMaterial")
links.new(image.outputs["Color"], tilt.inputs["Color"])
links.new(tilt.outputs["Normal"], paint.inputs["Normal"])
links.new(paint.outputs["BSDF"], out.inputs["Surface"])
plane.data.materials.append(material)

scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.samples = 16
scene.cycles.use_denoising = False
scene.cycles.filter_width = 0.01
scene.render.resolution_x, scene.render.resolution_y = columns, rows
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.view_settings.view_transform = "Raw"
eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
eye.data.type, eye.data.ortho_scale = "ORTHO", max(columns, rows) / rows
eye.location = (0.0, 0.0, 2.0)
lamp = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
lamp.data.energy, lamp.data.angle = math.pi, 0.0
for one in (eye, lamp):
    scene.collection.objects.link(one)
scene.camera = eye
across, rise = math.cos(math.pi / 6), math.sin(math.pi / 6)
for name, x, y in (("left", -1, 0), ("right", 1, 0), ("above", 0, 1), ("below", 0, -1)):
    travels = mathutils.Vector((-across * x, -across * y, -rise))
    lamp.rotation_euler = travels.to_track_quat("-Z", "Y").to_euler()
    scene.render.filepath = str(Path(folder).resolve() / f"{name}.exr")
    bpy.ops.render.render(write_still=True)
sys.stdout.write(f"\nIMPASTO {bpy.app.version_string.split()[0]}\n")
