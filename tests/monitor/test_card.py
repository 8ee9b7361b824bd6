from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.monitor.card import card_lines


def test_the_shipped_bundle_has_a_card():
    bundle = load_bundle(demo_bundle_path())
    lines = dict(
        card_lines(bundle.bundle_id, 0.9, 0.85, bundle.provenance and bundle.provenance.as_json(), bundle.doubt)
    )
    assert lines["Bundle"] == f"{bundle.bundle_id:04x}"
    assert lines["Thresholds"] == "acts from 90 %, holds below 85 %"
    assert "simulated" in lines["Trained on"]
    assert lines["Certificate"] == "none"


def test_a_bundle_without_provenance_says_why():
    assert ("Doubt", "sealed by nobody") in card_lines(1, 0.9, 0.8, None, "sealed by nobody")


def test_a_certificate_says_what_was_promised():
    promise = {"tau_on": 0.8, "precision": 0.75, "delta": 0.1, "people": 30, "origin": "recorded people"}
    assert dict(card_lines(1, 0.8, 0.7, {"certificate": promise}, None))["Certificate"] == (
        "act-only precision of 75% or more from 80%, with 90% confidence, 30 people (recorded people)"
    )
