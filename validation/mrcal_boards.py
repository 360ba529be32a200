"""Boards that mrcal makes and solves itself, as files for `retina import mrcal`.

    apt-get install --no-install-recommends mrcal python3-mrcal      # Debian 12: mrcal 2.2
    /usr/bin/python3 validation/mrcal_boards.py OUT [--frames N] [--corners WxH] [--model NAME=NUMBERS] [--noise-px PX]

Writes OUT.cameramodel (with optimization_inputs), OUT.vnl (the same corners as a table) and prints some directions that
the solved poses give, for comparison. The fixtures of retina-import/tests:

    validation/mrcal_boards.py retina-import/tests/fixtures/opencv8
    validation/mrcal_boards.py retina-import/tests/fixtures/splined --model \\
      LENSMODEL_SPLINED_STEREOGRAPHIC_order=2_Nx=8_Ny=6_fov_x_deg=120
"""

import argparse

import mrcal
import numpy as np
import numpysane as nps

arguments = argparse.ArgumentParser()
arguments.add_argument("out")
arguments.add_argument("--frames", type=int, default=8)
arguments.add_argument("--corners", default="7x6")
arguments.add_argument(
    "--model",
    default="LENSMODEL_OPENCV8:700,702,640.5,478,0.30,0.05,0.001,-0.002,0.004,0.65,0.12,0.01",
)
arguments.add_argument("--noise-px", type=float, default=0.05)
arguments.add_argument("--size", default="1280x960")
options = arguments.parse_args()
np.random.seed(3)

name, _, numbers = options.model.partition(":")
count = mrcal.lensmodel_num_params(name)
parameters = np.zeros(count)
given = [float(v) for v in (numbers or "500,502,640.5,478").split(",")]
parameters[: len(given)] = given
size = np.array([int(v) for v in options.size.split("x")])
width, height = (int(v) for v in options.corners.split("x"))
warp, spacing = np.array((0.004, -0.003)), 0.06
true = mrcal.cameramodel(intrinsics=(name, parameters), imagersize=size)
pixels, poses = mrcal.synthesize_board_observations(
    [true],
    object_width_n=width,
    object_height_n=height,
    object_spacing=spacing,
    calobject_warp=warp,
    rt_ref_boardcenter=np.array((0, 0, 0, 0, 0, 0.6)),
    rt_ref_boardcenter__noiseradius=np.array((0.5, 0.5, 1.5, 0.5, 0.4, 0.15)),
    Nframes=options.frames,
    which="some-cameras-must-see-half-board",
)
pixels = pixels[:, 0]
lost = np.any((pixels < 0) | (pixels > size - 1), axis=-1) | ~np.isfinite(pixels).all(axis=-1)
observed = nps.glue(pixels + np.random.randn(*pixels.shape) * options.noise_px, np.ones(lost.shape + (1,)), axis=-1)
observed[lost] = (0, 0, -1)
indices = np.zeros((options.frames, 3), dtype=np.int32)
indices[:, 0], indices[:, 2] = np.arange(options.frames), -1
inputs = dict(
    intrinsics=np.array([parameters]),
    extrinsics_rt_fromref=np.zeros((0, 6)),
    frames_rt_toref=mrcal.rt_from_Rt(poses),
    points=None,
    observations_board=observed,
    indices_frame_camintrinsics_camextrinsics=indices,
    observations_point=None,
    indices_point_camintrinsics_camextrinsics=None,
    lensmodel=name,
    imagersizes=np.array([size], dtype=np.int32),
    calobject_warp=warp.copy(),
    calibration_object_spacing=spacing,
    verbose=False,
)
solved = mrcal.optimize(**inputs)
model = mrcal.cameramodel(optimization_inputs=inputs, icam_intrinsics=0)
model.write(options.out + ".cameramodel")
with open(options.out + ".vnl", "w") as table:
    table.write("# filename x y level\n")
    for frame in range(options.frames):
        for x, y, weight in observed[frame].reshape(-1, 3):
            table.write(f"board-{frame:04}.png {x:.4f} {y:.4f} 0\n" if weight > 0 else f"board-{frame:04}.png - - -\n")

board = mrcal.ref_calibration_object(width, height, spacing, calobject_warp=inputs["calobject_warp"])
places = mrcal.transform_point_rt(nps.dummy(inputs["frames_rt_toref"], -2, -2), board)
kept = inputs["observations_board"]
error = (mrcal.project(places, *model.intrinsics()) - kept[..., :2])[kept[..., 2] > 0]
print(f"mrcal: {np.sqrt((error**2).mean()):.5f} px rms per axis, {(kept[..., 2] > 0).sum()} corners, {(kept[..., 2] <= 0).sum()} left out")
print("mrcal's own core:", model.intrinsics()[1][:4])
for frame, row, column in ((0, 0, 0), (1, 1, 2), (options.frames - 1, height - 1, width - 1)):
    x, y, z = places[frame, row, column]
    print(f"frame {frame} row {row} column {column}: line of sight [{x / z!r}, {y / z!r}], pixel {kept[frame, row, column].tolist()}")
