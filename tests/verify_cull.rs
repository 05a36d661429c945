//! `mullion verify cull`: a small run over every algorithm finds nothing dropped, and a seed makes the same run again.

mod support;

use std::time::Duration;

use mullion_server::cull::Algorithm;
use support::mullion;

/// Generous for a debug build on a busy machine.
const LIMIT: Duration = Duration::from_secs(120);

fn report(arguments: &[&str]) -> serde_json::Value {
    let done = mullion(&[&["verify", "cull", "--json", "-"], arguments].concat(), LIMIT);
    assert_eq!((done.code, done.err.as_str()), (Some(0), ""), "{}", done.out);
    serde_json::from_str(&done.out).expect("JSON")
}

#[test]
fn nothing_is_dropped() {
    let report = report(&["--cases", "3000000", "--seed", "7"]);
    assert!(report["cases"].as_u64() >= Some(3_000_000) && report["visible"].as_u64() > Some(100_000), "{report}");
    let contestants = report["contestants"].as_array().expect("a list");
    for name in
        Algorithm::ALL.map(Algorithm::name).into_iter().chain(["sweep, slack", "sweep, 2 threads", "adaptive, own frusta"])
    {
        assert!(contestants.iter().any(|c| c["name"] == name), "{name} was not asked");
    }
    for contestant in contestants {
        assert_eq!(contestant["dropped"], 0, "{contestant}");
        assert!(contestant["excess_percent"].as_f64().is_some_and(|excess| excess < 100.0), "{contestant}");
    }
}

#[test]
fn a_round_can_be_made_again() {
    let [first, again, other] = ["11", "11", "12"].map(|seed| report(&["--cases", "1", "--seed", seed]));
    assert_eq!(first, again);
    assert_eq!(first["rounds"], 1);
    assert_ne!(first["cases"], other["cases"]);
}

#[test]
fn wrong_numbers_are_told() {
    let done = mullion(&["verify", "cull", "--cases", "0"], LIMIT);
    assert_eq!(done.code, Some(2));
    assert!(done.err.starts_with("mullion: ") && done.err.contains("1..=1000000000"), "{}", done.err);
}
