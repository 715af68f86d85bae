"""Documents, rules and dashboard name the metrics of the code's table, and no others."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from common.metrics import METRICS, Metric

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs" / "metrics.md"
PROMETHEUS = ROOT / "deploy" / "prometheus"
DASHBOARD = ROOT / "deploy" / "grafana" / "legato.json"

OWN = re.compile(r"\blegato_[a-z_]+")
SERIES = {
    f"{each.name}{suffix}": each
    for each in METRICS
    for suffix in (("_bucket", "_sum", "_count") if each.kind == "histogram" else ("",))
}


def row_of(metric: Metric) -> str:
    labels = ", ".join(f"`{label}`" for label in metric.labels)
    return f"| `{metric.name}` | {metric.kind} | {metric.of} | {labels or '-'} | {metric.help} |"


def rules() -> list[dict[str, Any]]:
    groups = yaml.safe_load((PROMETHEUS / "rules.yml").read_text())["groups"]
    return [rule for group in groups for rule in group["rules"]]


def queries() -> list[str]:
    panels = json.loads(DASHBOARD.read_text())["panels"]
    return [target["expr"] for panel in panels for target in panel["targets"]]


def expressions() -> Iterator[str]:
    yield from (rule["expr"] for rule in rules())
    yield from queries()


def test_every_metric_is_documented_and_nothing_else():
    """To accept a change, copy the rows that the failure shows."""
    shown = [line for line in DOCS.read_text().splitlines() if line.startswith("| `legato_")]
    assert shown == [row_of(metric) for metric in METRICS]


def test_rules_and_dashboard_name_metrics_that_exist():
    named = {name for text in expressions() for name in OWN.findall(text)}
    assert named - SERIES.keys() == set()
    # Whatever is measured can be seen.
    assert {SERIES[name].name for text in queries() for name in OWN.findall(text)} == {
        metric.name for metric in METRICS
    }


def test_rules_and_dashboard_name_labels_that_exist():
    for text in expressions():
        for name, selector in re.findall(r"(legato_[a-z_]+)\{([^}]*)\}", text):
            asked = {each.split("=")[0].strip(' !~"') for each in selector.split(",")}
            assert asked <= {"node", *SERIES[name].labels}, text


def test_every_alert_says_what_is_wrong_and_is_tried():
    tests = yaml.safe_load((PROMETHEUS / "rules_test.yml").read_text())["tests"]
    fired = {
        each["alertname"]
        for test in tests
        for each in test["alert_rule_test"]
        if each["exp_alerts"]
    }
    assert fired == {rule["alert"] for rule in rules()}
    assert all(rule["annotations"]["summary"] for rule in rules())


def test_every_alert_is_documented():
    documented = set(re.findall(r"`(Legato[A-Za-z]+)`", DOCS.read_text()))
    assert documented == {rule["alert"] for rule in rules()}


def test_the_dashboard_can_be_imported():
    board = json.loads(DASHBOARD.read_text())
    assert board["uid"] == "legato"
    ids = [panel["id"] for panel in board["panels"]]
    assert len(ids) == len(set(ids))
    # Whoever imports it has a source of another id.
    assert {panel["datasource"]["uid"] for panel in board["panels"]} == {"${source}"}
    places = [panel["gridPos"] for panel in board["panels"]]
    assert all(place["x"] + place["w"] <= 24 for place in places)
    corners = {(place["x"], place["y"]) for place in places}
    assert len(corners) == len(places)


def test_prometheus_asks_every_service_of_the_compose_file():
    compose = yaml.safe_load((ROOT / "compose.yaml").read_text())
    config = yaml.safe_load((PROMETHEUS / "prometheus.yml").read_text())
    (job,) = config["scrape_configs"]
    (source,) = job["dns_sd_configs"]
    services = {name: each for name, each in compose["services"].items() if name != "prometheus"}
    assert set(source["names"]) == set(services)
    for service in services.values():
        assert service["environment"]["LEGATO_METRICS_PORT"] == str(source["port"])


def test_prometheus_is_asked_for_and_for_this_machine_only():
    service = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]["prometheus"]
    assert service["profiles"] == ["observe"]
    assert [port.split(":")[0] for port in service["ports"]] == ["127.0.0.1"]
    assert service["read_only"] is True
    assert set(service["networks"]) == {"bus", "observe"}
    assert (PROMETHEUS / Path(service["command"][0]).name).is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "config", "prometheus.yml"),
        ("check", "config", "laptop.yml"),
        ("check", "rules", "rules.yml"),
        ("test", "rules", "rules_test.yml"),
    ],
    ids=" ".join,
)
def test_prometheus_itself_takes_the_files(arguments: tuple[str, ...]):
    if shutil.which("promtool") is None:
        pytest.skip("promtool is not installed (Debian: apt install prometheus)")
    done = subprocess.run(
        ["promtool", *arguments], cwd=PROMETHEUS, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
