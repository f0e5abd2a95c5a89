//! `fixtures/results/harnesses.md`, part of `docs/design/harnesses.md`, written from the harnesses.

use std::fs;
use std::path::{Path, PathBuf};

const TABLE: &str = "../fixtures/results/harnesses.md";

fn here() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// One row for each test of a file: its name, claim and bound.
fn rows(file: &Path) -> Vec<String> {
    let module = file.file_stem().unwrap().to_str().unwrap();
    let text = fs::read_to_string(file).unwrap();
    let mut rows = Vec::new();
    let (mut doc, mut is_test) = (Vec::new(), false);
    for line in text.lines() {
        if let Some(text) = line.strip_prefix("///") {
            doc.push(text.trim().to_owned());
        } else if line == "#[test]" {
            is_test = true;
        } else if !line.starts_with("#[") {
            if let Some(name) = line.strip_prefix("fn ").filter(|_| is_test) {
                let name = name.split('(').next().unwrap();
                let paragraphs = doc.join(" ");
                let [claim, bound] = paragraphs.split("  ").collect::<Vec<_>>()[..] else {
                    panic!("{module}::{name}: expected a claim and a bound, found {paragraphs}");
                };
                rows.push(format!("| `{module}::{name}` | {claim} | {bound} |\n"));
            }
            doc.clear();
            is_test = false;
        }
    }
    rows
}

#[test]
fn the_page_lists_all_harnesses() {
    let files = fs::read_dir(here().join("src")).unwrap();
    let mut files: Vec<PathBuf> = files.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let this = Path::new(file!()).file_name();
    files.retain(|file| file.file_name() != this);
    let rows: Vec<String> = files.iter().flat_map(|file| rows(file)).collect();
    assert!(rows.len() >= 40, "{} harnesses", rows.len());
    let exhaustive = rows.iter().filter(|row| row.contains("exhaustive")).count();
    let head = format!("{} harnesses, {exhaustive} of them exhaustive.\n\n", rows.len());
    let table = format!("{head}| harness | claim | bound |\n|---|---|---|\n{}", rows.concat());
    let path = here().join(TABLE);
    let found = fs::read_to_string(&path).unwrap();
    if std::env::var_os("UPDATE_PAGES").is_some() {
        fs::write(&path, table).unwrap();
    } else {
        assert_eq!(
            found, table,
            "UPDATE_PAGES=1 cargo test -p hmd-harness table writes it again"
        );
    }
}
