//! Which siblings import which, and the circles among them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use super::modules::Tree;
use crate::shell::root;

/// Siblings that import each other, directly or through others.
#[derive(Debug)]
pub(crate) struct Circle {
    /// Their paths, in alphabetical order.
    pub(crate) rooms: Vec<String>,
    /// One line for each import between two of them.
    steps: BTreeSet<String>,
}

impl fmt::Display for Circle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.rooms.join(", "))?;
        for step in &self.steps {
            write!(f, "\n    {step}")?;
        }
        Ok(())
    }
}

/// Imports between rooms, each with the lines that show it.
type Edges = BTreeMap<usize, BTreeMap<usize, BTreeSet<String>>>;

/// All circles of a crate.
pub(crate) fn circles(tree: &Tree) -> Vec<Circle> {
    let edges = edges(tree);
    let reach: BTreeMap<usize, BTreeSet<usize>> = edges.keys().map(|room| (*room, reachable(&edges, *room))).collect();
    let both = |a: usize, b: usize| {
        let one_way = |a, b| reach.get(&a).is_some_and(|rooms: &BTreeSet<usize>| rooms.contains(&b));
        one_way(a, b) && one_way(b, a)
    };
    let mut left: BTreeSet<usize> = edges.keys().copied().filter(|room| both(*room, *room)).collect();
    let mut found = Vec::new();
    while let Some(first) = left.first().copied() {
        let members: BTreeSet<usize> = left.iter().copied().filter(|room| both(first, *room)).collect();
        left.retain(|room| !members.contains(room));
        let mut rooms: Vec<String> = members.iter().map(|room| tree.modules[*room].path.join("::")).collect();
        rooms.sort();
        let steps = members.iter().flat_map(|from| edges[from].iter());
        let steps = steps.filter(|(to, _)| members.contains(to));
        let steps = steps.flat_map(|(_, lines)| shown(lines)).collect();
        found.push(Circle { rooms, steps });
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
            // One contains the other: the same room.
            if common == a.len() || common == b.len() {
                continue;
            }
            let (room_a, room_b) = (ancestor(tree, from, common + 1), ancestor(tree, to, common + 1));
            let file = module.file.strip_prefix(root()).unwrap_or(&module.file).display();
            let names = |room: usize| tree.modules[room].path.join("::");
            let (one, other) = (names(room_a), names(room_b));
            let line = format!("{one} -> {other}: {} in {file}", path.join("::"));
            edges.entry(room_a).or_default().entry(room_b).or_default().insert(line);
        }
    }
    edges
}

/// Most lines shown of the imports from one room to another.
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

/// Rooms that a room imports, directly or through others.
fn reachable(edges: &Edges, from: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(room) = open.pop() {
        for to in edges.get(&room).into_iter().flat_map(BTreeMap::keys) {
            if reached.insert(*to) {
                open.push(*to);
            }
        }
    }
    reached
}
