"""An unmodified Prometheus scrapes `heronry metrics`: its target is up, and it has the samples of the snapshot."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.parse import quote
from urllib.request import urlopen

import pytest
from prometheus_client.parser import text_string_to_metric_families

from heronry_tools.watch.metrics import exposition
from watch.flights import big_blue, big_blue_log

PROMETHEUS = shutil.which("prometheus")
PATIENCE_S = 60
OURS, THEIRS = 19464, 19090

pytestmark = [
    pytest.mark.soak,
    pytest.mark.xdist_group("big_blue_log"),
    pytest.mark.skipif(PROMETHEUS is None, reason="there is no Prometheus here: as root, apt-get install prometheus"),
]


@contextmanager
def running(*words: str) -> Iterator[None]:
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


def asked(path: str) -> Any:
    with urlopen(f"http://127.0.0.1:{THEIRS}{path}", timeout=5) as answer:
        return json.load(answer)["data"]


def test_prometheus_scrapes_the_metrics_of_a_flight(tmp_path: Path) -> None:
    config = tmp_path / "prometheus.yml"
    target = f"{{job_name: heronry, scrape_interval: 1s, static_configs: [{{targets: ['127.0.0.1:{OURS}']}}]}}"
    config.write_text(f"scrape_configs: [{target}]\n")
    words = [sys.executable, "-m", "heronry_tools", "metrics", "--log", str(big_blue_log()), "big_blue"]
    listen = [f"--storage.tsdb.path={tmp_path}/data", f"--web.listen-address=127.0.0.1:{THEIRS}"]
    with running(*words, "--port", str(OURS)), running(str(PROMETHEUS), f"--config.file={config}", *listen):
        until_s, targets = time.monotonic() + PATIENCE_S, []
        while not any(one["health"] == "up" for one in targets):
            assert time.monotonic() < until_s, targets
            time.sleep(0.5)
            try:
                targets = asked("/api/v1/targets")["activeTargets"]
            except (URLError, ConnectionError):
                continue
        families = text_string_to_metric_families(exposition(big_blue().timeline().last()).decode())
        for family in families:
            found = asked(f"/api/v1/query?query={quote(family.samples[0].name)}")["result"] if family.samples else []
            assert len(found) == len(family.samples), family.name
            values = sorted(float(one["value"][1]) for one in found)
            assert values == pytest.approx(sorted(sample.value for sample in family.samples)), family.name
