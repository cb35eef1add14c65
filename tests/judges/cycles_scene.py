"""Renders a benchmark scene with Cycles, an independent judge of the reference renderer.

    pip install bpy==4.5.* numpy
    python tests/judges/cycles_scene.py SCENE.json Ac|At|B SPP WIDTH HEIGHT OUT.npy [PICTURES [FIRST_SEED]]

Writes what mitsuba_scene.py writes. Lights are emitting quads without a back, on the patch of the wall that the scene file
puts there. JUDGE_EVENTS sets how often a path scatters: 1 is direct light alone. Not part of any test run.
"""
import json
import os
import sys
import tempfile
import time

import bpy
import numpy as np

scene_file, variant, spp, width, height, out = sys.argv[1:7]
pictures = int(sys.argv[7]) if len(sys.argv) > 7 else 1
spp, width, height = int(spp), int(width), int(height)
S = json.load(open(scene_file))

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.engine = 'CYCLES'
cycles = scene.cycles
cycles.device = 'CPU'
cycles.samples = spp
cycles.use_adaptive_sampling = False
cycles.use_denoising = False
cycles.sample_clamp_direct = 0.0
cycles.sample_clamp_indirect = 0.0
cycles.blur_glossy = 0.0
cycles.caustics_reflective = True
cycles.caustics_refractive = True
# A path of n scatterings has n - 1 bounces.
events = int(os.environ.get('JUDGE_EVENTS', S['max_scattering_events']['B' if variant == 'B' else 'A']))
cycles.max_bounces = events - 1
for kind in ('diffuse', 'glossy', 'transmission', 'transparent_max'):
    setattr(cycles, f'{kind}_bounces', events - 1)
cycles.pixel_filter_type = 'BOX'
scene.render.threads_mode = 'FIXED'
scene.render.threads = int(os.environ.get('JUDGE_THREADS', '2'))
scene.world = bpy.data.worlds.new('dark')
scene.world.use_nodes = True
scene.world.node_tree.nodes['Background'].inputs['Strength'].default_value = 0.0


def diffuse(name, albedo=None, image=None):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    bsdf, end = nodes.new('ShaderNodeBsdfDiffuse'), nodes.new('ShaderNodeOutputMaterial')
    bsdf.inputs['Roughness'].default_value = 0.0
    if image is None:
        bsdf.inputs['Color'].default_value = (albedo, albedo, albedo, 1.0)
    else:
        texture = nodes.new('ShaderNodeTexImage')
        texture.image, texture.interpolation, texture.extension = image, 'Linear', 'EXTEND'
        links.new(texture.outputs['Color'], bsdf.inputs['Color'])
    links.new(bsdf.outputs['BSDF'], end.inputs['Surface'])
    return material


def glowing(name, radiance, albedo):
    """Emits from its front, reflects on both sides."""
    material = diffuse(name, albedo)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    bsdf = next(n for n in nodes if n.type == 'BSDF_DIFFUSE')
    end = next(n for n in nodes if n.type == 'OUTPUT_MATERIAL')
    emission, both, side, mix = (nodes.new('ShaderNode' + n) for n in
                                 ('Emission', 'AddShader', 'NewGeometry', 'MixShader'))
    peak = max(radiance)
    emission.inputs['Color'].default_value = (*[r / peak for r in radiance], 1.0)
    emission.inputs['Strength'].default_value = peak
    links.new(bsdf.outputs['BSDF'], both.inputs[0])
    links.new(emission.outputs['Emission'], both.inputs[1])
    links.new(side.outputs['Backfacing'], mix.inputs['Fac'])
    links.new(both.outputs['Shader'], mix.inputs[1])
    links.new(bsdf.outputs['BSDF'], mix.inputs[2])
    links.new(mix.outputs['Shader'], end.inputs['Surface'])
    return material


def mesh(name, points, faces, material, uvs=None):
    data = bpy.data.meshes.new(name)
    data.from_pydata([tuple(map(float, p)) for p in points], [], [tuple(map(int, f)) for f in faces])
    if uvs is not None:
        layer = data.uv_layers.new(name='uv')
        corners = np.empty(len(data.loops), dtype=np.int32)
        data.loops.foreach_get('vertex_index', corners)
        layer.data.foreach_set('uv', uvs[corners].astype(np.float32).ravel())
    data.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new(name, data))


def quad(name, c, n, ud, su, vd, sv, material):
    c, n, ud, vd = (np.array(v, float) for v in (c, n, ud, vd))
    if np.dot(np.cross(ud, vd), n) < 0:
        ud = -ud
    u, v = ud * su / 2, vd * sv / 2
    mesh(name, [c - u - v, c + u - v, c + u + v, c - u + v], [(0, 1, 2, 3)], material)


# The pad.
e = S['elastomer']
nx, ny = e['nx'], e['ny']
X, Y = np.meshgrid(np.linspace(-10, 10, nx), np.linspace(-7.5, 7.5, ny))
r = np.hypot(X - e['cx'], Y - e['cy'])
Z = np.where(r <= e['rc'], e['d'] - e['R'] + np.sqrt(np.maximum(e['R'] ** 2 - r * r, 0)),
             e['hc'] * np.exp(-e['k'] * (r - e['rc'])))
points = np.stack([X, Y, Z], -1).reshape(-1, 3)
uvs = np.stack([(X + 10) / 20, (Y + 7.5) / 15], -1).reshape(-1, 2)
i, j = np.meshgrid(np.arange(nx - 1), np.arange(ny - 1))
a = (j * nx + i).ravel()
faces = np.concatenate([np.stack([a, a + 1, a + nx + 1], 1), np.stack([a, a + nx + 1, a + nx], 1)])
image = None
if variant == 'At':
    U, V = np.meshgrid((np.arange(640) + .5) / 640, (np.arange(480) + .5) / 480)
    x, y = 20 * U - 10, 15 * V - 7.5
    near = lambda t: t - (2 * np.round((t - 1) / 2) + 1)
    m = 1 - .85 * np.exp(-(np.hypot(near(x), near(y)) / .25) ** 4)
    texels = np.stack([m * (.55 + .15 * np.sin(2 * np.pi * x / 5)), m * (.5 + .2 * np.sin(2 * np.pi * (x + y) / 4)),
                       m * (.45 + .15 * np.cos(2 * np.pi * y / 3)), np.ones_like(x)], -1).astype(np.float32)
    image = bpy.data.images.new('texture', 640, 480, float_buffer=True, is_data=True)
    image.pixels.foreach_set(texels.ravel())
    image.update()
mesh('pad', points, faces, diffuse('pad', e['albedo_const'], image), uvs)

# Walls, lights, plate.
box = S['box']
wall = diffuse('wall', box['albedo'])
quad('w1', [-10, 0, 9.75], [1, 0, 0], [0, 1, 0], 15, [0, 0, 1], 20.5, wall)
quad('w2', [10, 0, 9.75], [-1, 0, 0], [0, 1, 0], 15, [0, 0, 1], 20.5, wall)
quad('w3', [0, -7.5, 9.75], [0, 1, 0], [1, 0, 0], 20, [0, 0, 1], 20.5, wall)
quad('w4', [0, 7.5, 9.75], [0, -1, 0], [1, 0, 0], 20, [0, 0, 1], 20.5, wall)
quad('ceiling', [0, 0, 20], [0, 0, -1], [1, 0, 0], 20, [0, 1, 0], 15, wall)
for l in S['lights']:
    quad(l['name'], l['center_mm'], l['normal'], l['u_dir'], l['size_u_mm'], l['v_dir'], l['size_v_mm'],
         glowing(l['name'], l['radiance_linear_rgb'], box['albedo']))
if variant == 'B':
    p = S['plate']
    glass = bpy.data.materials.new('plate')
    glass.use_nodes = True
    nodes = glass.node_tree.nodes
    nodes.clear()
    bsdf, end = nodes.new('ShaderNodeBsdfGlass'), nodes.new('ShaderNodeOutputMaterial')
    bsdf.inputs['Roughness'].default_value = 0.0
    bsdf.inputs['IOR'].default_value = p['ior']
    glass.node_tree.links.new(bsdf.outputs['BSDF'], end.inputs['Surface'])
    corner = [(x, y, z) for z in p['z'] for y in p['y'] for x in p['x']]
    mesh('plate', corner, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)], glass)

# The camera looks down; its x is the scene's.
camera = bpy.data.cameras.new('camera')
camera.sensor_fit = 'HORIZONTAL'
camera.angle_x = np.radians(S['camera']['hfov_deg'])
camera.clip_start = 0.01
seen_from = bpy.data.objects.new('camera', camera)
seen_from.location = S['camera']['origin']
scene.collection.objects.link(seen_from)
scene.camera = seen_from
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
scene.view_settings.view_transform = 'Raw'
scene.render.image_settings.file_format = 'OPEN_EXR'
scene.render.image_settings.color_depth = '32'

rendered = []
first = int(sys.argv[8]) if len(sys.argv) > 8 else 0
for seed in range(first, first + pictures):
    cycles.seed = seed
    start = time.time()
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = os.path.join(folder, 'picture.exr')
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = 'Non-Color'
        numbers = np.empty(width * height * 4, dtype=np.float32)
        image.pixels.foreach_get(numbers)
        bpy.data.images.remove(image)
    rendered.append(numbers.reshape(height, width, 4)[::-1, :, :3].copy())
    print(variant, seed, 'mean', rendered[-1].mean((0, 1)), 's', time.time() - start, flush=True)
    np.save(out, np.stack(rendered))
