//! Import cycles: modules of one crate that import each other, directly or through others.
//!
//! In: the library and the programs of every package of the workspace. Out: each cycle with one import for each of its
//! steps; any cycle is an error.
//!
//! The idea: a file and its submodules count as one module. An import between two modules is an edge between the two children of
//! their nearest common parent which contain them, and no set of siblings may import each other. An import of a name that
//! a module passes on (`pub use b::X`) is an import of the module where the name is defined. What a parent defines is free
//! for its children, and what a child defines is free for its parent: these count as one. Code for tests does not count.

mod graph;
mod modules;

use std::path::Path;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::shell::{cargo, root};

/// Looks for import cycles in every crate of the workspace.
pub(crate) fn check() -> anyhow::Result<()> {
    let metadata = ["metadata", "--no-deps", "--offline", "--format-version", "1"];
    let output = cargo(metadata).output().context("cargo metadata")?;
    ensure!(output.status.success(), "cargo metadata: {}", output.status);
    let metadata: Value = serde_json::from_slice(&output.stdout).context("cargo metadata")?;
    let (mut crates, mut modules, mut cycles) = (0, 0, 0);
    for package in list(&metadata["packages"]) {
        for target in list(&package["targets"]).filter(|target| is_product(target)) {
            let file = Path::new(target["src_path"].as_str().context("src_path of a target")?);
            let tree = modules::Tree::read(file)?;
            let found = graph::cycles(&tree);
            for cycle in &found {
                let shown = file.strip_prefix(root()).unwrap_or(file).display();
                println!("{} ({shown}): {cycle}", package["name"].as_str().unwrap_or_default());
            }
            crates += 1;
            modules += tree.modules.len();
            cycles += found.len();
        }
    }
    println!("{crates} crates, {modules} modules, {cycles} import cycles");
    ensure!(cycles == 0, "expected no import cycle, found {cycles}");
    Ok(())
}

/// Whether a target is a library or a program, and no test, example, benchmark or build script.
fn is_product(target: &Value) -> bool {
    list(&target["kind"]).any(|kind| {
        kind.as_str()
            .is_some_and(|kind| kind == "bin" || kind.ends_with("lib") || kind == "proc-macro")
    })
}

fn list(values: &Value) -> impl Iterator<Item = &Value> {
    values.as_array().into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cycles of a crate whose files are given by their paths; the first one is its root.
    fn cycles(files: &[(&str, &str)]) -> Vec<String> {
        let folder = std::env::temp_dir().join(format!("cycles-{}-{:p}", std::process::id(), files));
        for (path, text) in files {
            let file = folder.join(path);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        }
        let tree = modules::Tree::read(&folder.join(files[0].0)).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let found = graph::cycles(&tree);
        found.iter().map(|cycle| cycle.modules.join(" ")).collect()
    }

    #[test]
    fn two_files_that_import_each_other_are_a_cycle() {
        let found = cycles(&[
            ("lib.rs", "mod a; mod b; mod c;"),
            ("a.rs", "use crate::b::B; pub struct A(B); use crate::c::C;"),
            ("b.rs", "pub struct B; fn f() -> super::a::A { todo!() }"),
            ("c.rs", "pub struct C;"),
        ]);
        assert_eq!(found, ["a b"]);
    }

    #[test]
    fn a_cycle_of_three_is_one() {
        let found = cycles(&[
            ("lib.rs", "mod a; mod b; mod c;"),
            ("a.rs", "use crate::b::B;"),
            ("b.rs", "pub struct B; use crate::{c::{self, C}};"),
            ("c.rs", "pub struct C; use super::a;"),
        ]);
        assert_eq!(found, ["a b c"]);
    }

    #[test]
    fn a_file_and_its_submodules_count_as_one_module() {
        let found = cycles(&[
            ("lib.rs", "mod a; mod b;"),
            (
                "a.rs",
                "mod inner; pub use inner::Inner; pub struct A; use crate::b::B;",
            ),
            ("a/inner.rs", "use super::A; pub struct Inner;"),
            ("b.rs", "pub struct B;"),
        ]);
        assert_eq!(found, [""; 0]);
        let found = cycles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a/mod.rs", "mod inner; use crate::b::B;"),
            ("a/inner.rs", "pub struct Inner;"),
            ("b.rs", "pub struct B; mod low { use crate::a::inner::Inner; }"),
        ]);
        assert_eq!(found, ["a b"]);
    }

    #[test]
    fn a_name_that_a_parent_passes_on_counts_where_it_is_defined() {
        let found = cycles(&[
            ("lib.rs", "mod outer;"),
            (
                "outer.rs",
                "mod a; mod b; pub use a::A; pub(crate) use b::*; pub struct Own;",
            ),
            ("outer/a.rs", "use super::{B, Own}; pub struct A;"),
            ("outer/b.rs", "use crate::outer::A as Other; pub struct B;"),
        ]);
        assert_eq!(found, ["outer::a outer::b"]);
        let found = cycles(&[
            ("lib.rs", "mod outer;"),
            ("outer.rs", "mod a; mod b; pub use a::A; pub struct Own;"),
            ("outer/a.rs", "use super::*; pub struct A; fn f() -> Own { todo!() }"),
            ("outer/b.rs", "use super::*; pub struct B; fn f() -> A { todo!() }"),
        ]);
        assert_eq!(found, [""; 0]);
    }

    #[test]
    fn names_that_come_by_a_star_count_where_they_are_used() {
        let found = cycles(&[
            ("lib.rs", "mod outer;"),
            ("outer.rs", "mod a; mod b; pub use a::A; use b::B;"),
            ("outer/a.rs", "use super::*; pub struct A; fn f() -> B { todo!() }"),
            ("outer/b.rs", "use super::*; pub struct B; fn f() -> A { todo!() }"),
        ]);
        assert_eq!(found, ["outer::a outer::b"]);
    }

    #[test]
    fn macros_and_paths_within_them_count() {
        let found = cycles(&[
            ("lib.rs", "#[macro_use] mod a; mod b;"),
            ("a.rs", "macro_rules! low { () => { $crate::b::B } }"),
            ("b.rs", "pub struct B; fn f() { low!(); }"),
        ]);
        assert_eq!(found, ["a b"]);
        let found = cycles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "pub fn a() { println!(\"{}\", crate::b::b()); }"),
            ("b.rs", "use crate::a; pub fn b() {}"),
        ]);
        assert_eq!(found, ["a b"]);
    }

    #[test]
    fn code_for_tests_and_documentation_do_not_count() {
        let found = cycles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "use crate::b::B; pub struct A;"),
            (
                "b.rs",
                "/// See [`crate::a::A`].\npub struct B;\n#[cfg(test)] mod tests { use crate::a::A; }\n\
                 #[cfg(all(test, unix))] use crate::a::A;\nimpl B { #[cfg(test)] fn f(_: crate::a::A) {} }",
            ),
        ]);
        assert_eq!(found, [""; 0]);
    }

    #[test]
    fn the_workspace_is_read() {
        let tree = modules::Tree::read(&root().join("xtask/src/main.rs")).unwrap();
        let names: Vec<_> = tree.modules.iter().map(|module| module.path.join("::")).collect();
        assert!(names.contains(&"circles::graph".to_owned()), "{names:?}");
    }
}
