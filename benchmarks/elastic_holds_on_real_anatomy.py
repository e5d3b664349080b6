"""The live elastic field beside real bone and in thin layers: its error, what it says of it, and what a needle may do.

Claims, at defaults, in crops of a real abdomen, the kidney scene and hard blocks that nothing was tuned on:
60 frames of a pass are within 0.05 of the converged field from the fifth on and within 0.01 at the end, 0.05 and
0.01 in the first and third frame after a withdrawal; the published error is never below half the true one and within
three times in 95 % of frames; against a fine grid, in anatomy of parts of its voxels, 0.03 on 25^3-like nodes and
0.012 on 49^3-like ones, at the tip 0.05 (in a soft inclusion 0.06) of the peak; scikit-fem on the same cells and
moduli gives the same field; the tip moves by the same within 3 % wherever the needle is in its cell, in boxes to
10 : 1; crops of the abdomen whose walls give way move the tip alike within 3 %; nodal forces add up to the load; into
every rib at all angles tissue moves by at most 10 mm, det J stays above 0.2 and no frame takes 100 ms.

    python benchmarks/elastic_holds_on_real_anatomy.py [live] [grid] [ripple] [crops] [force] [bone]

The abdomen is in the folder SONOSPLINE_SHARED_DATA. An hour for all; `--quick` takes one face of a crop.
Ends with 1 where a limit is missed.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import sonospline as ss
from gauss_reference import same_cells
from hard_blocks import bone_cases, layer_cases, soft_cases
from judged_pass import JudgedPass
from real_anatomy import (
    ABDOMEN,
    CROPS,
    abdomen,
    abdomen_cases,
    abdomen_names,
    finest_parts,
    kidney,
    kidney_cases,
    labels_of,
    needles_into,
    parts_of_voxels,
)
from sonospline.elasticity import ElasticSolver
from sonospline.geometry.grid import FACES
from sonospline.mechanics import Material, default_load
from sonospline.mechanics.continued_walls import WALLS
from sonospline.models.elastic import ElasticModel

FINE = 97
AT_REST = 3e-4
GRID_LIMITS = {25: 0.03, 49: 0.012}
TIP_LIMIT, SOFT_TIP_LIMIT = 0.05, 0.06
BOXES = ((100, 100, 100), (240, 120, 60), (363, 300, 87), (300, 60, 60), (400, 100, 40), (400, 400, 40), (500, 50, 50))
ANGLES, DET_J_EVERY_MM = 4, 10
QUICK = "--quick" in sys.argv

missed = []


def cases():
    """All of them: those of the abdomen where its data are."""
    if ABDOMEN.is_file():
        for kind in CROPS:
            yield from abdomen_cases(kind, faces=1 if QUICK else 3)
    else:
        print(f"the real abdomen is left out: {ABDOMEN} is not there")
    yield from kidney_cases()
    yield from bone_cases()
    yield from layer_cases()
    yield from soft_cases()


def report(line, **limits):
    """Print a line, and what of it is beyond its limit: name = (value, most)."""
    beyond = [name.replace("_", " ") for name, (value, most) in limits.items() if not value <= most]
    missed.extend(f"{line.split(':')[0].strip()}: {name}" for name in beyond)
    print(line + (f"  MISSED: {', '.join(beyond)}" if beyond else ""), flush=True)


def live():
    """Error of the iteration, and what is published of it."""
    ratios = []
    for case in cases():
        judged = JudgedPass(ElasticModel(case.tissue, case.tissues), case)
        judged.push()
        worst, last, tip = max(judged.true[4:]), judged.true[-1], max(judged.tip[4:])
        back = judged.withdraw()
        ratios.append(judged.ratios)
        least = judged.ratios.min()
        report(
            f"{case.name:44s}: from frame 5 {worst:.4f}, last {last:.4f}, tip {tip:.4f}; withdrawn {back[0]:.4f}, "
            f"{back[2]:.4f}; published over true {least:.2f} to {judged.ratios.max():.2f}",
            from_frame_5=(worst, 0.05), last=(last, 0.01), tip=(tip, 0.05), withdrawn=(back[0], 0.05),
            third_after=(back[2], 0.01), published_too_low=(0.5, least),
        )  # fmt: skip
    found = np.concatenate(ratios)
    near = np.mean((found >= 1 / 3) & (found <= 3))
    report(
        f"published over true error, {len(found)} frames: smallest {found.min():.2f}, median {np.median(found):.2f}, "
        f"95 % {np.percentile(found, 95):.2f}, largest {found.max():.2f}; within three times in {near:.1%}",
        smallest=(0.5, found.min()), within_three_times=(0.95, near),
    )  # fmt: skip


def finished(case, nodes):
    """A model and its response at the end of the way, at rest: a load that follows the tissue, too."""
    model = ElasticModel(case.tissue, case.tissues, nodes=nodes, tolerance=AT_REST, budget=200)
    response = model.step(model.rest, {"needle": case.needle})
    for _ in range(5):
        response = model.step(model.settle(response, tolerance=AT_REST).state, {"needle": case.needle})
    return model, model.settle(response, tolerance=AT_REST)


def passed(case, nodes):
    """The last response of 60 frames at defaults."""
    model = ElasticModel(case.tissue, case.tissues, nodes=nodes)
    response = model.step(model.rest, {"needle": case.at(1 / 60)})
    for k in range(2, 61):
        response = model.step(response.state, {"needle": case.at(k / 60)})
    return response


def imaged(case):
    return case.tissues in (abdomen(), kidney().tissues) if ABDOMEN.is_file() else case.tissues is kidney().tissues


def reference_nodes(case):
    """In anatomy that was imaged the cells are parts of voxels: any other grid blurs bone, and is itself off by 1 %."""
    box, labels = case.tissue.grid, case.tissues.labels
    return parts_of_voxels(box, labels, finest_parts(box, labels)) if imaged(case) else FINE**3


def grid():
    """Error of live fields against a fine grid, and of the solver against scikit-fem."""
    for case in cases():
        places = np.vstack([case.tissue.grid.points[~case.tissue.pinned.ravel()], case.needle.tip])
        try:
            _, fine = finished(case, reference_nodes(case))
        except RuntimeError as error:
            report(f"{case.name:44s}: {error}", converged=(1, 0))
            continue
        expected = fine.field.displacement(places)
        soft = case.name == "soft sphere"
        for side, most in GRID_LIMITS.items():
            away, tip = apart(passed(case, side**3), places, expected)
            alone, _ = apart(finished(case, side**3)[1], places, expected)
            report(
                f"{case.name:44s}: {side}^3-like {away:.4f} (of its cells alone {alone:.4f}), tip {tip:.4f}",
                mean=(away, most), tip=(tip, SOFT_TIP_LIMIT if soft else TIP_LIMIT),
            )  # fmt: skip
        box, labels = case.tissue.grid, case.tissues.labels
        for parts in [n for n in (1, 2) if imaged(case) and n < finest_parts(box, labels)]:
            cells = parts_of_voxels(box, labels, parts)
            away, tip = apart(finished(case, cells)[1], places, expected)
            report(f"{case.name:44s}: 1/{parts} of a voxel, {cells.node_count:,} nodes: {away:.4f}, tip {tip:.4f}")
        off = same_cells(*finished(case, 13**3), case)
        report(f"{case.name:44s}: scikit-fem on the same cells {off:.5f}", scikit_fem=(off, 5e-3))


def apart(response, places, expected):
    """Mean distance of a field from what is expected, over its mean; and that at the last place, over its largest."""
    off = np.linalg.norm(response.field.displacement(places) - expected, axis=1)
    sizes = np.linalg.norm(expected, axis=1)
    return off[:-1].mean() / sizes[:-1].mean(), off[-1] / sizes.max()


def ripple():
    """How much the tip's displacement depends on the needle's place in its cell."""
    for sides in np.array(BOXES, float):
        for face in ("x-", "z-"):
            axis = FACES.index(face) // 2
            model = ElasticModel(ss.Tissue(ss.Grid.covering(sides), face), Material(10))
            moved = []
            for shift in np.eye(3) * model.solver.grid.spacing:
                at = np.linspace(-1, 1, 13)
                lengths = np.array([tip_moved(model, needle_in(sides, axis, s * shift)) for s in at])
                smooth = np.polyval(np.polyfit(at, lengths, 2), at)
                moved.append(np.ptp(lengths - smooth) / lengths.mean())
            report(
                f"box {' x '.join(f'{side:g}' for side in sides)} mm, {face}: ripple "
                + ", ".join(f"{r:.3f}" for r in moved),
                ripple=(max(moved), 0.03),
            )


def needle_in(sides, axis, shift):
    entry, tip = sides * (0.45, 0.52, 0.47) + shift, sides * (0.5, 0.47, 0.52) + shift
    entry[axis] = 0.0
    return ss.Needle(entry, tip)


def tip_moved(model, needle):
    response = model.step(model.rest, {"needle": needle})
    for _ in range(3):
        response = model.step(model.settle(response, tolerance=1e-3).state, {"needle": needle})
    return np.linalg.norm(model.settle(response, tolerance=1e-3).field.displacement(needle.tip))


def crops():
    """How much the tip's displacement depends on how much of a body is cut out around the same needle."""
    if not ABDOMEN.is_file():
        return
    for face, entry, tip, boxes in crops_of_three_sizes(np.random.default_rng(2), 12):
        needle, moved = ss.Needle(entry, tip), {}
        for walls in WALLS:
            solvers = [ElasticSolver(ss.Tissue(box, face), abdomen(), nodes=box, walls=walls) for box in boxes]
            load = default_load(abdomen())
            fields = [solver.field(solver.solve(load, needle, tolerance=2e-4)) for solver in solvers]
            moved[walls] = np.array([np.linalg.norm(field.displacement(tip)) for field in fields])
        off = {walls: lengths[:2] / lengths[2] - 1 for walls, lengths in moved.items()}
        report(
            f"{face}, {needle.depth:.0f} mm: crops of 96 and 144 mm against 200: "
            + ", ".join(f"{walls} {small:+.3f} {middle:+.3f}" for walls, (small, middle) in off.items()),
            apart=(np.abs(off["continued"]).max(), 0.03),
        )


def crops_of_three_sizes(rng, count, spacing=4.0):
    """Needles by chance into soft tissue, each with grids around it that begin at the same plane."""
    labels = abdomen().labels
    whole = labels.grid(1000)
    while count:
        middle, axis = whole.extent * rng.uniform(0.25, 0.75, 3), int(rng.integers(2))
        end, depth = int(rng.integers(2)), rng.uniform(35, 65)
        lows, boxes = [], [np.array(sides) for sides in ((96.0, 96, 72), (144.0, 144, 84), (200.0, 200, 84))]
        for sides in boxes:
            low = middle - sides / 2
            low[axis] = middle[axis] + 48 - sides[axis] if end else middle[axis] - 48
            low[2] = np.clip(low[2], 0, whole.extent[2] - sides[2])
            lows.append(low)
        if any((low < 0).any() or (low + sides > whole.extent).any() for low, sides in zip(lows, boxes, strict=True)):
            continue
        entry = middle + rng.uniform(-12, 12, 3)
        entry[2] = np.clip(entry[2], lows[0][2] + 15, lows[0][2] + 57)
        tip = entry + rng.uniform(-12, 12, 3)
        entry[axis] = middle[axis] + (48 if end else -48)
        tip[axis] = entry[axis] + (-depth if end else depth)
        entry, tip = whole.world(np.array([entry, tip]))
        needle = ss.Needle(entry, tip)
        if abdomen().obstacle(needle) or (abdomen().labels_at(needle.at(np.linspace(0, 1, 50))) == 0).mean() > 0.6:
            continue
        count -= 1
        shapes = [tuple(np.rint(sides / spacing).astype(int) + 1) for sides in boxes]
        grids = [
            ss.Grid(shape=shape, spacing=spacing, origin=whole.world(low[None])[0], direction=whole.direction)
            for shape, low in zip(shapes, lows, strict=True)
        ]
        yield FACES[2 * axis + end], entry, tip, grids


def force():
    """Nodal forces against the load, and the reaction of what holds the tissue; the load's own fixed point."""
    for case in cases():
        model, response = finished(case, 25**3)
        solution, said = response.state.solution, response.forces["needle"]
        on_nodes = case.tissue.grid.direction @ solution.load.sum(axis=(1, 2, 3), dtype=float)
        nominal = model.load.total_force(case.needle, case.tissue.depth_below_entry_face(case.needle.tip))
        total = abs(1000 * (said.axial_n + said.lost_n) / nominal - 1)
        balance = np.linalg.norm(on_nodes + model.solver.reaction(solution)) / np.linalg.norm(on_nodes)
        live = ElasticModel(case.tissue, case.tissues, nodes=25**3)
        moving = passed(case, 25**3)
        held = live.step(live.step(moving.state, {"needle": case.needle}).state, {"needle": case.needle})
        lags = [lag(model.solver, each.state.solution, solution) for each in (moving, held)]
        report(
            f"{case.name:44s}: {nominal / 1000:.3f} N, off by {total:.1e}, reaction by {balance:.1e}; "
            f"the load's fixed point: off by {lags[0]:.4f} as the needle moves, {lags[1]:.4f} two frames on",
            total=(total, 1e-3), balance=(balance, 1e-3), fixed_point=(lags[0], 0.005), held=(lags[1], 0.005),
        )  # fmt: skip


def lag(solver, live, at_rest):
    """How far the field that a live load converges to is from that at rest, over its mean."""
    own = solver.settle(live, tolerance=2e-5).displacement
    away = np.linalg.norm(own - at_rest.displacement, axis=0).mean()
    return away / np.linalg.norm(at_rest.displacement, axis=0).mean()


def bone():
    """Pushes into every rib, at all angles, and on."""
    rng = np.random.default_rng(4)
    scene = kidney()
    jobs = [
        ("kidney's rib", scene.tissues, label, scene.tissue.grid, 3 * ANGLES) for label in bone_labels(scene.tissues)
    ]
    if ABDOMEN.is_file():
        box = abdomen().labels.grid(150_000)
        jobs += [(abdomen_names()[label], abdomen(), label, box, ANGLES) for label in labels_of("rib", "vertebrae")]
    models = {}
    for name, tissues, label, box, count in jobs:
        for face, needle in needles_into(tissues, label, box, rng, count):
            if (id(tissues), face) not in models:
                models[id(tissues), face] = ElasticModel(ss.Tissue(box, face), tissues)
            pushed(name, models[id(tissues), face], face, needle)


def bone_labels(tissues):
    return [label for label, material in tissues.materials.items() if material.rigid]


def pushed(name, model, face, needle, beyond_mm=15.0):
    """A push, millimetre by millimetre, that goes on past the bone."""
    response, largest, least, slowest = model.step(model.rest), 0.0, 1.0, 0.0
    depths = np.arange(1.0, needle.depth + beyond_mm)
    for depth in depths:
        tip = needle.entry + depth * needle.direction
        if not model.tissue.grid.contains(tip[None])[0]:
            break
        start = time.perf_counter()
        response = model.step(response.state, {"needle": ss.Needle(needle.entry, tip)})
        slowest = max(slowest, 1e3 * (time.perf_counter() - start))
        largest = max(largest, np.linalg.norm(response.state.solution.displacement, axis=0).max())
        if depth % DET_J_EVERY_MM == 0 or depth == depths[-1]:
            least = min(least, det_j(response.field.on_grid(), model.tissue.grid))
    report(
        f"{name:16s} from {face}, {needle.depth:.0f} mm: moved {largest:.1f} mm, det J {least:.2f}, slowest frame "
        f"{slowest:.0f} ms, {'stops' if response.blocked else 'goes on'}",
        moved=(largest, 10.0), det_j=(0.2, least), frame=(slowest, 100.0), stops=(1, len(response.blocked)),
    )  # fmt: skip


def det_j(u, grid):
    along = u @ grid.direction
    gradient = np.stack([np.gradient(along, h, axis=axis) for axis, h in enumerate(grid.spacing)], axis=-1)
    return np.linalg.det(np.eye(3) + gradient).min()


PARTS = {"live": live, "grid": grid, "ripple": ripple, "crops": crops, "force": force, "bone": bone}
if __name__ == "__main__":
    for part in [name for name in sys.argv[1:] if name in PARTS] or PARTS:
        print(f"{part}: {PARTS[part].__doc__}")
        PARTS[part]()
    print(f"{len(missed)} missed" + "".join(f"\n  {what}" for what in missed))
    sys.exit(bool(missed))
