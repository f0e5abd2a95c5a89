//! Every requirement of `docs/safety.md` names tests, and they are there.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::path::Path;

#[test]
fn every_requirement_has_the_tests_that_it_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = std::fs::read_to_string(root.join("docs/safety.md")).unwrap();
    let rows = page.lines().filter(|line| line.starts_with("| S-"));
    let mut numbers = Vec::new();
    for row in rows {
        let cells: Vec<_> = row.split('|').map(str::trim).collect();
        numbers.push(cells[1].trim_start_matches("S-").parse::<u32>().unwrap());
        let (mut file, mut named) = (String::new(), cells[3].contains("S-") || cells[3].contains("CAN"));
        for name in cells[3].split('`').skip(1).step_by(2) {
            let test = match name.split_once("::") {
                Some((path, test)) => {
                    file = std::fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
                    test
                }
                None => name,
            };
            assert!(
                file.contains(&format!("fn {test}(")),
                "{}: there is no test {test}",
                cells[1]
            );
            named = true;
        }
        assert!(named, "{}: no test", cells[1]);
    }
    assert_eq!(
        numbers,
        (1..=numbers.len() as u32).collect::<Vec<_>>(),
        "numbered from 1 without gaps"
    );
    // Whoever is named by a hazard exists.
    for line in page.lines().filter(|line| line.starts_with("| H-")) {
        for part in line.split(['|', ',', ' ']).filter_map(|part| part.strip_prefix("S-")) {
            assert!(numbers.contains(&part.parse().unwrap()), "{line}");
        }
    }
}
