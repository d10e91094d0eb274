"""The command line: a dict of verbs, each a typed function whose docstring is its help."""

from __future__ import annotations

import difflib
import os
import sys
import traceback
from collections.abc import Callable, Sequence

import tyro

from coin3d.commands.build_scenes import build_scenes
from coin3d.commands.check import check
from coin3d.commands.convert import convert
from coin3d.commands.demo import demo
from coin3d.commands.detect import detect
from coin3d.commands.evaluate import evaluate
from coin3d.commands.pretrain import pretrain
from coin3d.commands.protocols import protocols
from coin3d.commands.re_render import re_render
from coin3d.commands.render import render
from coin3d.commands.rig import rig
from coin3d.commands.rig_import import rig_import
from coin3d.commands.rig_report import rig_report
from coin3d.commands.town import town
from coin3d.commands.train import train

VERBS: dict[str, Callable[..., None]] = {
    "demo": demo,
    "check": check,
    "rig": rig,
    "rig import": rig_import,
    "rig report": rig_report,
    "detect": detect,
    "convert": convert,
    "town": town,
    "build-scenes": build_scenes,
    "render": render,
    "re-render": re_render,
    "pretrain": pretrain,
    "train": train,
    "evaluate": evaluate,
    "protocols": protocols,
}
"""Verb -> function; the signature is the command line, the docstring its help."""

TUTORIAL = """\
CoIn3D: multi-camera 3D object detection that transfers to camera rigs it was never trained on.

usage: coin3d VERB ... --out DIR        every verb writes DIR/result.json and says where its pictures are
       coin3d VERB --help               what a verb takes, with examples to copy

{verbs}

See it work (a few minutes on two cores, no download):
  coin3d demo --out out/demo                        open out/demo/report.html

Your own cameras: describe them in rig.yaml beside the images (docs/your_rig.md), look, then detect:
  coin3d check recordings/van --out out/check       rings on the ground must lie on the road
  coin3d rig recordings/van --other nuscenes --out out/rigs
  coin3d rig report recordings/van --checkpoint runs/mine/model.safetensors --out out/van
                                                    is this a rig that those weights know?
  coin3d rig import camchain.yaml --base-pose 1.7 0 1.4 0 0 0 --out recordings/van/rig.yaml
  coin3d detect town-coin3d recordings/van --out out/boxes
                                                    the shipped weights know only the town, no real street

Weights that others released, for real streets (docs/convert.md):
  coin3d convert bevformer_tiny_epoch_24.pth weights/bevformer.safetensors
  coin3d detect weights/bevformer.safetensors recordings/van --out out/boxes

Rebuild annotated frames as 3D Gaussians and look through cameras that were not there:
  coin3d town --out data/town --scenes 1 --sweeps
  coin3d build-scenes data/town --out data/town_scenes --width 400
  coin3d render data/town_scenes/town-0000 --rig waymo --out out/views

Train on one rig, evaluate on another:
  coin3d town --out data/train --rig nuscenes --scenes 60
  coin3d town --out data/val --rig waymo --scenes 10 --first-seed 5000
  coin3d train data/train --out runs/coin3d
  coin3d evaluate runs/coin3d/model.safetensors data/val --out out/score
  coin3d pretrain data/train --out runs/trunk       an image trunk to start transformers from:
  coin3d train data/train --out runs/petr --detector petr --trunk runs/trunk/model.safetensors

A wrong file or value ends in one line and exit code 2; COIN3D_DEBUG=1 shows the traceback.
"""


def main(args: Sequence[str] | None = None) -> int:
    """Run a verb; returns the exit code."""
    args = list(sys.argv[1:] if args is None else args)
    if not args or args[0] in ("-h", "--help", "help"):
        print(TUTORIAL.format(verbs="\n".join(f"  {name:<14}{_summary(verb)}" for name, verb in VERBS.items())), end="")
        return 0 if args else 2
    name, *rest = args
    if rest and f"{name} {rest[0]}" in VERBS:
        name, *rest = f"{name} {rest[0]}", *rest[1:]
    if name == "--version":
        from importlib.metadata import version

        print(f"coin3d {version('coin3d')}")
        return 0
    if name not in VERBS:
        near = difflib.get_close_matches(name, VERBS, 1)
        hint = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(VERBS)}"
        return _fail(f"no verb '{name}'{hint}")
    try:
        tyro.cli(VERBS[name], args=rest, prog=f"coin3d {name}")
    except BrokenPipeError:  # whoever read our output has gone; without this the interpreter complains while it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (ValueError, OSError, ImportError) as error:
        if os.environ.get("COIN3D_DEBUG"):
            traceback.print_exc()
        return _fail(str(error))
    except KeyboardInterrupt:
        print("interrupted; train, town and demo continue where they stopped when called again", file=sys.stderr)
        return 130
    return 0


def _summary(verb: Callable[..., None]) -> str:
    return (verb.__doc__ or "").strip().partition("\n")[0]


def _fail(message: str) -> int:
    print(f"coin3d: error: {' '.join(message.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
