//! Which siblings import which, and the cycles among them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use super::modules::Tree;
use crate::shell::root;

/// Siblings that import each other, directly or through others.
#[derive(Debug)]
pub(crate) struct Cycle {
    /// Their paths, in alphabetical order.
    pub(crate) modules: Vec<String>,
    /// One line for each import between two of them.
    steps: BTreeSet<String>,
}

impl fmt::Display for Cycle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.modules.join(", "))?;
        for step in &self.steps {
            write!(f, "\n    {step}")?;
        }
        Ok(())
    }
}

/// Imports between modules, each with the lines that show it.
type Edges = BTreeMap<usize, BTreeMap<usize, BTreeSet<String>>>;

/// All cycles of a crate.
pub(crate) fn cycles(tree: &Tree) -> Vec<Cycle> {
    let edges = edges(tree);
    let reach: BTreeMap<usize, BTreeSet<usize>> = edges
        .keys()
        .map(|module| (*module, reachable(&edges, *module)))
        .collect();
    let both = |a: usize, b: usize| {
        let one_way = |a, b| {
            reach
                .get(&a)
                .is_some_and(|modules: &BTreeSet<usize>| modules.contains(&b))
        };
        one_way(a, b) && one_way(b, a)
    };
    let mut left: BTreeSet<usize> = edges.keys().copied().filter(|module| both(*module, *module)).collect();
    let mut found = Vec::new();
    while let Some(first) = left.first().copied() {
        let members: BTreeSet<usize> = left.iter().copied().filter(|module| both(first, *module)).collect();
        left.retain(|module| !members.contains(module));
        let mut modules: Vec<String> = members
            .iter()
            .map(|module| tree.modules[*module].path.join("::"))
            .collect();
        modules.sort();
        let steps = members.iter().flat_map(|from| edges[from].iter());
        let steps = steps.filter(|(to, _)| members.contains(to));
        let steps = steps.flat_map(|(_, lines)| shown(lines)).collect();
        found.push(Cycle { modules, steps });
    }
    found
}

fn edges(tree: &Tree) -> Edges {
    let mut edges = Edges::new();
    for (from, module) in tree.modules.iter().enumerate() {
        for path in &module.paths {
            let Some(to) = tree.defining_module(from, path) else {
                continue;
            };
            let (a, b) = (&module.path, &tree.modules[to].path);
            let common = a.iter().zip(b).take_while(|(a, b)| a == b).count();
            // One contains the other: they count as one module.
            if common == a.len() || common == b.len() {
                continue;
            }
            let (module_a, module_b) = (ancestor(tree, from, common + 1), ancestor(tree, to, common + 1));
            let file = module.file.strip_prefix(root()).unwrap_or(&module.file).display();
            let names = |module: usize| tree.modules[module].path.join("::");
            let (one, other) = (names(module_a), names(module_b));
            let line = format!("{one} -> {other}: {} in {file}", path.join("::"));
            edges
                .entry(module_a)
                .or_default()
                .entry(module_b)
                .or_default()
                .insert(line);
        }
    }
    edges
}

/// Most lines shown of the imports from one module to another.
const SHOWN_MAX: usize = 3;

/// The lines with whole paths where there are some: the names that they import follow from them.
fn shown(lines: &BTreeSet<String>) -> impl Iterator<Item = String> {
    let is_whole = |line: &&String| line.contains(": crate::") || line.contains(": super::");
    let whole: Vec<&String> = lines.iter().filter(is_whole).collect();
    let chosen = if whole.is_empty() {
        lines.iter().collect()
    } else {
        whole
    };
    chosen.into_iter().take(SHOWN_MAX).cloned()
}

/// The module at a depth on the way from the root to `at`.
fn ancestor(tree: &Tree, at: usize, depth: usize) -> usize {
    let mut at = at;
    while tree.modules[at].path.len() > depth {
        at = tree.modules[at].parent.unwrap_or(0);
    }
    at
}

/// Modules that a module imports, directly or through others.
fn reachable(edges: &Edges, from: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(module) = open.pop() {
        for to in edges.get(&module).into_iter().flat_map(BTreeMap::keys) {
            if reached.insert(*to) {
                open.push(*to);
            }
        }
    }
    reached
}
