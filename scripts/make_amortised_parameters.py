"""Learn Table I's seven parameters by site, direction and depth from elastic fields, and write them for the package.

    python scripts/make_amortised_parameters.py [--insertions 240] [--ridge 0.01]

The file is data of the package: `sonospline.mechanics.AmortisedParameters` reads it. Takes minutes on two cores.
"""

import argparse
import json
import sys
from importlib.metadata import version
from pathlib import Path

from sonospline.io.writing import write_text
from sonospline.mechanics import AmortisedParameters, NeedleTissueModel
from sonospline.study.amortising import compare, drawn_insertions, learn
from sonospline.study.parallel import usable_processors

FILE = Path(__file__).parents[1] / "src" / "sonospline" / "mechanics" / "amortised.json"
LEARNT_SEED, DIGITS = 1, 6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--insertions", type=int, default=240, help="to learn from (240)")
    parser.add_argument("--ridge", type=float, default=0.01, help="(0.01)")
    args = parser.parse_args()
    samples, workers = drawn_insertions(args.insertions, seed=LEARNT_SEED), usable_processors()
    found = learn(
        samples, ridge=args.ridge, workers=workers, say=lambda text: sys.stderr.write(f"{text}\n") and None
    )  # fmt: skip
    rounded = json.loads(json.dumps(found.values()), parse_float=lambda text: float(f"{float(text):.{DIGITS}g}"))
    tuned = NeedleTissueModel.tuned()
    sets = {"tuned": lambda tissue, needle: tuned, "amortised": AmortisedParameters.of(rounded).model}
    errors = compare(samples, sets, workers=workers)
    made_by = (
        f"scripts/make_amortised_parameters.py with sonospline {version('sonospline')}: {args.insertions} insertions, "
        f"ridge {args.ridge:g}; on these errors of {errors['tuned'].relative:.4f} with the constant set, "
        f"{errors['amortised'].relative:.4f} with these"
    )
    write_text(FILE, json.dumps({"made_by": made_by, "parameters": rounded}) + "\n")


if __name__ == "__main__":
    main()
