"""Blender's side of ``exports.py``: imports a ``.glb`` and renders it from the front.

    blender -b --factory-startup --python exports_blender.py -- PANEL.glb PICTURE.exr WIDTH HEIGHT

A sun from above at 45 degrees in whose full light a white board is 1; one pixel of the picture is
one of the texture.
"""

import math
import sys

import bpy
import mathutils
import numpy

# Blender 3.4's importer of glTF uses a name that later versions of numpy have not.
numpy.bool = bool

glb, picture, width, height = sys.argv[-4:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=glb)
panel = next(one for one in bpy.data.objects if one.type == "MESH")
for node in panel.data.materials[0].node_tree.nodes:
    if node.bl_idname == "ShaderNodeTexImage":
        node.interpolation = "Closest"

scene = bpy.context.scene
scene.render.engine = "CYCLES"
scene.cycles.samples = 64
scene.cycles.use_denoising = False
scene.cycles.filter_width = 0.01
scene.render.resolution_x, scene.render.resolution_y = int(width), int(height)
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.view_settings.view_transform = "Raw"
scene.render.use_file_extension = False
scene.render.filepath = picture

# Blender has z up: the panel, which faces glTF's z, faces -y.
eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
eye.data.type, eye.data.ortho_scale = "ORTHO", max(panel.dimensions)
eye.location, eye.rotation_euler = (0.0, -1.0, 0.0), (math.pi / 2, 0.0, 0.0)
lamp = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
lamp.data.energy, lamp.data.angle = math.pi, 0.0
lamp.rotation_euler = mathutils.Vector((0.0, 1.0, -1.0)).to_track_quat("-Z", "Y").to_euler()
for one in (eye, lamp):
    scene.collection.objects.link(one)
scene.camera = eye
bpy.ops.render.render(write_still=True)
size = ",".join(f"{one:.9g}" for one in panel.dimensions)
sys.stdout.write(f"\nIMPASTO {bpy.app.version_string.split()[0]} {size}\n")
