//! Sources with all mutants in them, of which the environment switches one on: one build for all instead of one for each.
//!
//! The body of a function becomes a choice: the body itself, or a copy of it with one change. What the compiler refuses is taken out again.

use std::collections::BTreeMap;
use std::ops::Range;

use anyhow::Context;
use proc_macro2::LineColumn;
use serde_json::Value;
use syn::visit::Visit;

/// The environment's name of the mutant that is on: its number, from 1.
pub(super) const SWITCH: &str = "MUTANT";

/// What the copy of a crate gets behind its root file.
pub(super) const SWITCH_MODULE: &str = r#"
#[allow(missing_docs, unreachable_pub)]
mod mutant_switch {
    extern crate std;
    static ACTIVE: std::sync::OnceLock<usize> = std::sync::OnceLock::new();
    pub fn active() -> usize {
        *ACTIVE.get_or_init(|| std::env::var("MUTANT").ok().and_then(|text| text.parse().ok()).unwrap_or(0))
    }
}
"#;

/// One change to one place.
#[derive(Clone, Debug)]
pub(super) struct Mutant {
    /// As `cargo-mutants` names it: place, change and function.
    pub(super) name: String,
    /// Below the workspace's root.
    pub(super) file: String,
    at: [LineColumn; 2],
    replacement: String,
}

impl Mutant {
    /// Path of the module that the file is, as it stands before the names of its tests.
    pub(super) fn module_path(&self) -> String {
        let inner = self.file.split_once("/src/").map_or(&*self.file, |(_, inner)| inner);
        inner.trim_end_matches(".rs").replace('/', "::")
    }

    /// From an entry of `cargo mutants --list --json`, which counts lines and columns from 1.
    pub(super) fn read(entry: &Value) -> Option<Self> {
        let place = |end: &str| {
            let at = &entry["span"][end];
            Some(LineColumn {
                line: usize::try_from(at["line"].as_u64()?).ok()?,
                column: usize::try_from(at["column"].as_u64()?).ok()?.checked_sub(1)?,
            })
        };
        let text = |key: &str| Some(entry[key].as_str()?.to_owned());
        Some(Self {
            name: text("name")?,
            file: text("file")?,
            at: [place("start")?, place("end")?],
            replacement: text("replacement")?,
        })
    }
}

/// A file with mutants in it.
#[derive(Debug)]
pub(super) struct Switched {
    pub(super) text: String,
    /// The lines, from 1, in which each mutant's copy stands.
    pub(super) lines: BTreeMap<usize, Range<usize>>,
}

/// Number of a mutant, the bytes that it changes, and what stands there then.
type Change<'a> = (usize, Range<usize>, &'a str);

/// A file with these of its mutants, by their numbers. Those of constants and constant functions, which nothing can switch, are left out.
pub(super) fn switched(source: &str, mutants: &[(usize, &Mutant)]) -> anyhow::Result<Switched> {
    let mut bodies = Bodies::default();
    bodies.visit_file(&syn::parse_file(source)?);
    let offsets = Offsets::of(source);
    // The outermost function: what is changed in one within it is changed in a copy of both.
    let mut by_body: BTreeMap<(usize, usize), Vec<Change<'_>>> = BTreeMap::new();
    for (number, mutant) in mutants {
        let place = offsets.at(mutant.at[0]).zip(offsets.at(mutant.at[1]));
        let (start, end) = place.with_context(|| mutant.name.clone())?;
        let body = bodies.0.iter().find(|body| body.start <= start && end <= body.end);
        if let Some(body) = body {
            let copies = by_body.entry((body.start, body.end)).or_default();
            copies.push((*number, start..end, &mutant.replacement));
        }
    }
    let (mut text, mut lines, mut done) = (String::new(), BTreeMap::new(), 0);
    for ((start, end), copies) in by_body {
        text.push_str(&source[done..start]);
        let numbers: Vec<String> = copies.iter().map(|(number, ..)| number.to_string()).collect();
        text.push_str("{ match crate::mutant_switch::active() {\n");
        text.push_str(&format!(
            "active_mutant if !matches!(active_mutant, {}) => ",
            numbers.join(" | ")
        ));
        text.push_str(&source[start..end]);
        for (number, place, replacement) in copies {
            text.push_str(&format!("\n{number} => "));
            let first = text.lines().count();
            // Spaces, so that it does not join with what stands beside it.
            text.push_str(&source[start..place.start]);
            text.push_str(&format!(" {replacement} "));
            text.push_str(&source[place.end..end]);
            lines.insert(number, first..text.lines().count() + 1);
        }
        text.push_str("\n_ => unreachable!(),\n} }");
        done = end;
    }
    text.push_str(&source[done..]);
    Ok(Switched { text, lines })
}

/// Bodies of functions that are in no other one, with their braces.
#[derive(Default)]
struct Bodies(Vec<Range<usize>>);

impl Bodies {
    fn add(&mut self, signature: &syn::Signature, block: &syn::Block) {
        if signature.constness.is_none() {
            self.0.push(block.brace_token.span.join().byte_range());
        }
    }
}

impl<'a> Visit<'a> for Bodies {
    fn visit_item_fn(&mut self, item: &'a syn::ItemFn) {
        self.add(&item.sig, &item.block);
    }

    fn visit_impl_item_fn(&mut self, item: &'a syn::ImplItemFn) {
        self.add(&item.sig, &item.block);
    }

    fn visit_trait_item_fn(&mut self, item: &'a syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.add(&item.sig, block);
        }
    }
}

/// Where each line of a text begins.
struct Offsets<'a> {
    text: &'a str,
    lines: Vec<usize>,
}

impl<'a> Offsets<'a> {
    fn of(text: &'a str) -> Self {
        let ends = text.match_indices('\n').map(|(at, _)| at + 1);
        Self {
            text,
            lines: [0].into_iter().chain(ends).collect(),
        }
    }

    /// The byte at a place whose column counts characters.
    fn at(&self, place: LineColumn) -> Option<usize> {
        let start = *self.lines.get(place.line.checked_sub(1)?)?;
        let line = &self.text[start..];
        let inner = line.char_indices().map(|(at, _)| at).nth(place.column);
        inner.map(|at| start + at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mutant(line: usize, columns: Range<usize>, replacement: &str) -> Mutant {
        Mutant {
            name: String::new(),
            file: String::new(),
            at: [columns.start, columns.end].map(|column| LineColumn { line, column }),
            replacement: replacement.to_owned(),
        }
    }

    #[test]
    fn each_mutant_is_a_copy_of_its_functions_body() {
        let source = "/// µ {\nfn f(a: u8) -> bool { a > 1 }\nconst fn g() -> u8 { 1 + 1 }\nstruct S;\nimpl S { fn h() { f(2); } }\n";
        let mutants = [
            mutant(2, 24..25, ">="),
            mutant(2, 22..27, "true"),
            mutant(3, 23..24, "-"),
            mutant(5, 18..22, "()"),
        ];
        let numbered: Vec<(usize, &Mutant)> = (1..).zip(&mutants).collect();
        let found = switched(source, &numbered).unwrap();
        let expected = "/// µ {\nfn f(a: u8) -> bool { match crate::mutant_switch::active() {\n\
            active_mutant if !matches!(active_mutant, 1 | 2) => { a > 1 }\n1 => { a  >=  1 }\n2 => {  true  }\n_ => unreachable!(),\n} }\n\
            const fn g() -> u8 { 1 + 1 }\nstruct S;\nimpl S { fn h() { match crate::mutant_switch::active() {\n\
            active_mutant if !matches!(active_mutant, 4) => { f(2); }\n4 => {  () ; }\n_ => unreachable!(),\n} } }\n";
        assert_eq!(found.text, expected);
        assert_eq!(found.lines, BTreeMap::from([(1, 4..5), (2, 5..6), (4, 12..13)]));
    }
}
