//! A unit that nobody knows but by its data sheet and ten recordings: the small form of the example `new_unit`.

#[path = "../new_units.rs"]
pub(crate) mod new_units;

use new_units::Trial;

#[test]
fn a_unit_known_by_ten_recordings_raises_no_false_alarm_and_shows_its_faults() {
    let trial = Trial {
        windows: 12,
        worn: 1,
        ..Trial::of_type("bench").expect("a configuration")
    };
    let found = trial.unit(2).expect("a commissioned unit");
    assert_eq!((found.judged, found.accused), (found.healthy, 0), "{}", found.line());
    assert_eq!(found.named, found.worn, "{}", found.line());
    // 95 % of many lie within two sigmas, of these 14 at least 11.
    assert!(found.within >= 11, "{}", found.line());
}
