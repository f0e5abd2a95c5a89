//! `docs/effects.md` has the rows of the catalogue, and names the tests of each.

use std::fs;
use std::path::Path;

use ema_models::reference::EFFECTS;

/// A number as the page writes it.
fn number(x: f64) -> String {
    let size = x.abs();
    if size > 0.0 && !(1e-3..1e4).contains(&size) {
        return format!("{x:e}");
    }
    let digits = format!("{x:.4}");
    digits.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn range((min, max): (f64, f64)) -> String {
    if (max - min).abs() <= 0.0 {
        number(max)
    } else if (min + max).abs() <= 0.0 {
        format!("±{}", number(max))
    } else {
        format!("{}…{}", number(min), number(max))
    }
}

#[test]
fn the_page_has_every_effect_with_a_test_that_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("../../docs/effects.md")).unwrap();
    let mut tests = String::new();
    for entry in fs::read_dir(root.join("tests/all/effects")).unwrap() {
        tests += &fs::read_to_string(entry.unwrap().path()).unwrap();
    }
    let rows: Vec<Vec<&str>> = page
        .lines()
        .filter(|line| line.starts_with("|`"))
        .map(|line| line.trim_matches('|').split('|').collect())
        .collect();
    for (n, info) in EFFECTS.iter().enumerate() {
        let expected = [
            format!("`{}`", info.name),
            info.unit.to_owned(),
            range(info.usual),
            info.equation.to_owned(),
            info.source.to_owned(),
        ];
        let row = rows.get(n).map_or(&[][..], |row| row);
        assert_eq!(
            row.get(..5),
            Some(&expected.each_ref().map(String::as_str)[..]),
            "row {n}"
        );
        for test in row.get(5).unwrap().split(", ") {
            let test = test.trim_matches('`');
            assert!(
                tests.contains(&format!("\nfn {test}()")),
                "{}: no test {test}",
                info.name
            );
        }
    }
    assert_eq!(rows.len(), EFFECTS.len());
}
