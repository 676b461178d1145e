"""Are posteriors calibrated? `jointbayes calibrate` for cases with ever more that is uncertain: `make science`.

Writes its part of docs/calibration.md and a figure for each variant.
"""

import argparse
import json
from pathlib import Path

import jointbayes as jb
from benchmarks.calibration_data import VARIANTS, case_of
from benchmarks.calibration_page import SUMMARY, write_figure, write_page
from benchmarks.record import merged
from jointbayes.studies.calibration import calibration_lines

ROOT = Path(__file__).resolve().parents[1]
SEED = 20261122


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--variant", action="append", choices=list(VARIANTS), help="may be repeated; default: all")
    parser.add_argument("--count", type=int, default=500, help="data sets of each variant; default 500")
    parser.add_argument("--workers", type=int, help="processes; by default one for each processor")
    parser.add_argument("--pilot", action="store_true", help="print only: leave page, figures and summary as they are")
    options = parser.parse_args()
    for variant in options.variant or VARIANTS:

        def tell(progress: jb.Progress, variant: str = variant) -> None:
            if progress.done % 10 == 0:
                print(f"{variant}: {progress}", flush=True)

        found = jb.calibrate(case_of(variant), options.count, seed=SEED, workers=options.workers, progress=tell)
        print(*calibration_lines(found), sep="\n")
        if not options.pilot:
            kept = json.loads(SUMMARY.read_text(encoding="utf-8")) if SUMMARY.exists() else {}
            data = {**kept, **merged(None, variant, found.summary(), False)}
            SUMMARY.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
            write_figure(variant, found.quantities)
            write_page()


if __name__ == "__main__":
    main()
