//! The modules of a crate: what each defines, what it takes under another name, and every path it writes.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use anyhow::Context;
use proc_macro2::{Delimiter, TokenStream, TokenTree};
use quote::ToTokens;
use syn::{Attribute, Item, UseTree};

/// One module.
#[derive(Debug, Default)]
pub(crate) struct Module {
    /// Names from the root down; empty for the root.
    pub(crate) path: Vec<String>,
    pub(crate) file: PathBuf,
    pub(crate) parent: Option<usize>,
    pub(crate) children: HashMap<String, usize>,
    /// Names defined here.
    items: BTreeSet<String>,
    /// Macros defined here, which later modules see without a path.
    macros: BTreeSet<String>,
    /// Imported names, each with the path that it stands for.
    aliases: HashMap<String, Vec<String>>,
    /// Paths whose names are imported by a star.
    stars: Vec<Vec<String>>,
    /// Every path written here, imports among them.
    pub(crate) paths: BTreeSet<Vec<String>>,
}

/// The modules of one crate, parents before their children.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    pub(crate) modules: Vec<Module>,
}

/// What a name stands for.
#[derive(Clone, Copy)]
enum Found {
    Module(usize),
    /// Something defined in that module, or that it takes from another crate.
    In(usize),
}

impl Tree {
    /// The tree below a root file.
    pub(crate) fn read(root: &Path) -> anyhow::Result<Self> {
        let mut tree = Self::default();
        let folder = root.parent().unwrap_or(Path::new("")).to_owned();
        tree.read_file(root, &folder, Vec::new(), None)?;
        Ok(tree)
    }

    /// Adds the module of a file, whose submodules lie in `folder`.
    fn read_file(
        &mut self,
        file: &Path,
        folder: &Path,
        path: Vec<String>,
        parent: Option<usize>,
    ) -> anyhow::Result<usize> {
        let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let syntax = syn::parse_file(&text).with_context(|| file.display().to_string())?;
        self.add(syntax.items, file, folder, path, parent)
    }

    fn add(
        &mut self,
        items: Vec<Item>,
        file: &Path,
        folder: &Path,
        path: Vec<String>,
        parent: Option<usize>,
    ) -> anyhow::Result<usize> {
        let here = self.modules.len();
        self.modules.push(Module {
            path,
            file: file.to_owned(),
            parent,
            ..Module::default()
        });
        for item in items {
            let tokens = item.to_token_stream();
            let (attributes, _) = split_attributes(tokens.clone());
            if attributes.iter().any(is_for_tests) {
                continue;
            }
            if let Item::Mod(item) = item {
                let name = item.ident.to_string();
                let mut below = self.modules[here].path.clone();
                below.push(name.clone());
                let inner = folder.join(&name);
                let child = match item.content {
                    Some((_, items)) => self.add(items, file, &inner, below, Some(here))?,
                    None => {
                        let beside = file.parent().unwrap_or(Path::new(""));
                        let candidates = match path_attribute(&item.attrs) {
                            Some(named) => vec![beside.join(named)],
                            None => vec![folder.join(format!("{name}.rs")), inner.join("mod.rs")],
                        };
                        let found = candidates.iter().find(|file| file.is_file());
                        let found = found.with_context(|| format!("file of module {}", below.join("::")))?;
                        self.read_file(found, &inner, below, Some(here))?
                    }
                };
                self.modules[here].children.insert(name, child);
                continue;
            }
            let module = &mut self.modules[here];
            if let Item::Use(item) = &item {
                module.import(&item.tree, &mut Vec::new());
            }
            if let Some(name) = defined(&item) {
                if matches!(item, Item::Macro(_)) {
                    module.macros.insert(name.clone());
                }
                module.items.insert(name);
            }
            collect(tokens, &mut module.paths);
        }
        Ok(here)
    }

    /// The module in which the thing that a path names is defined; none when it is of another crate or a local name.
    pub(crate) fn defining_module(&self, from: usize, path: &[String]) -> Option<usize> {
        self.resolve(from, path, &mut BTreeSet::new()).map(|found| match found {
            Found::Module(at) | Found::In(at) => at,
        })
    }

    fn resolve(&self, from: usize, path: &[String], seen: &mut BTreeSet<(usize, String)>) -> Option<Found> {
        let mut rest = path.iter();
        let first = rest.next()?;
        let mut at = match first.as_str() {
            "crate" => 0,
            "self" => from,
            "super" => self.modules[from].parent?,
            name => match self.find(from, name, seen).or_else(|| self.textual_macro(name))? {
                Found::Module(at) => at,
                found @ Found::In(_) => return Some(found),
            },
        };
        for name in rest {
            at = match name.as_str() {
                "super" => self.modules[at].parent?,
                "self" => at,
                name => match self.find(at, name, seen) {
                    Some(Found::Module(at)) => at,
                    Some(found) => return Some(found),
                    // Made by a macro, or passed on from another crate by a star.
                    None => return Some(Found::In(at)),
                },
            };
        }
        Some(Found::Module(at))
    }

    fn find(&self, at: usize, name: &str, seen: &mut BTreeSet<(usize, String)>) -> Option<Found> {
        let module = &self.modules[at];
        if let Some(child) = module.children.get(name) {
            return Some(Found::Module(*child));
        }
        if module.items.contains(name) {
            return Some(Found::In(at));
        }
        if !seen.insert((at, name.to_owned())) {
            return None;
        }
        if let Some(path) = module.aliases.get(name) {
            return Some(self.resolve(at, path, seen).unwrap_or(Found::In(at)));
        }
        module.stars.iter().find_map(|star| {
            let Some(Found::Module(from)) = self.resolve(at, star, seen) else {
                return None;
            };
            self.find(from, name, seen)
        })
    }

    /// A macro that needs no path, by a `name!` from anywhere in the crate.
    fn textual_macro(&self, name: &str) -> Option<Found> {
        let name = name.strip_suffix('!')?;
        let at = self.modules.iter().position(|module| module.macros.contains(name))?;
        Some(Found::In(at))
    }
}

impl Module {
    fn import(&mut self, tree: &UseTree, prefix: &mut Vec<String>) {
        match tree {
            UseTree::Path(path) => {
                prefix.push(path.ident.to_string());
                self.import(&path.tree, prefix);
                prefix.pop();
            }
            UseTree::Group(group) => {
                for tree in &group.items {
                    self.import(tree, prefix);
                }
            }
            UseTree::Glob(_) => self.stars.push(prefix.clone()),
            UseTree::Name(name) => self.alias(&name.ident.to_string(), &name.ident.to_string(), prefix),
            UseTree::Rename(rename) => self.alias(&rename.rename.to_string(), &rename.ident.to_string(), prefix),
        }
    }

    fn alias(&mut self, alias: &str, name: &str, prefix: &[String]) {
        let mut path = prefix.to_vec();
        let mut alias = alias;
        if name == "self" {
            if alias == "self" {
                alias = prefix.last().map_or("self", String::as_str);
            }
        } else {
            path.push(name.to_owned());
        }
        // `use a::b` of another crate stands for itself: to follow it would end where it began.
        if path.len() > 1 || path.first().is_some_and(|first| first != alias) {
            self.aliases.insert(alias.to_owned(), path);
        }
    }
}

/// The name that an item defines.
fn defined(item: &Item) -> Option<String> {
    let ident = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Macro(item) => item.ident.as_ref()?,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::Type(item) => &item.ident,
        Item::Union(item) => &item.ident,
        _ => return None,
    };
    Some(ident.to_string())
}

/// The file that `#[path = "..."]` names.
fn path_attribute(attributes: &[Attribute]) -> Option<String> {
    attributes.iter().find_map(|attribute| {
        let text = attribute.to_token_stream().to_string();
        let (_, value) = text.split_once("path = \"")?;
        Some(value.split('"').next()?.to_owned())
    })
}

/// Whether an attribute keeps what follows for tests: `#[test]`, or a `cfg` that needs `test`.
fn is_for_tests(attribute: &TokenStream) -> bool {
    let text = attribute.to_string().replace(' ', "");
    text == "test" || text.starts_with("cfg(test") || text.starts_with("cfg(all(test")
}

/// The attributes at the start of a stream, each without its brackets, and what follows them.
fn split_attributes(tokens: TokenStream) -> (Vec<TokenStream>, Vec<TokenTree>) {
    let mut attributes = Vec::new();
    let trees: Vec<TokenTree> = tokens.into_iter().collect();
    let mut at = 0;
    while let Some((inner, next)) = attribute(&trees, at) {
        attributes.push(inner);
        at = next;
    }
    (attributes, trees[at..].to_vec())
}

/// The attribute at a place, and the place after it.
fn attribute(trees: &[TokenTree], at: usize) -> Option<(TokenStream, usize)> {
    let TokenTree::Punct(hash) = trees.get(at)? else {
        return None;
    };
    let inner = matches!(trees.get(at + 1), Some(TokenTree::Punct(bang)) if bang.as_char() == '!');
    let place = at + 1 + usize::from(inner);
    match trees.get(place)? {
        TokenTree::Group(group) if hash.as_char() == '#' && group.delimiter() == Delimiter::Bracket => {
            Some((group.stream(), place + 1))
        }
        _ => None,
    }
}

/// Every path in a stream, those of macros and of imports within functions among them, but not what is for tests.
fn collect(tokens: TokenStream, paths: &mut BTreeSet<Vec<String>>) {
    let trees: Vec<TokenTree> = tokens.into_iter().collect();
    let mut at = 0;
    while at < trees.len() {
        if let Some((inner, next)) = attribute(&trees, at) {
            at = if is_for_tests(&inner) {
                after_item(&trees, next)
            } else {
                strings(&inner, paths);
                next
            };
            continue;
        }
        match &trees[at] {
            TokenTree::Group(group) => {
                collect(group.stream(), paths);
                at += 1;
            }
            // A field or a method.
            TokenTree::Punct(dot) if dot.as_char() == '.' => {
                let range = matches!(trees.get(at + 1), Some(TokenTree::Punct(next)) if next.as_char() == '.');
                at += if range || !matches!(trees.get(at + 1), Some(TokenTree::Ident(_))) {
                    1
                } else {
                    2
                };
            }
            TokenTree::Ident(_) => at = collect_path(&trees, at, Vec::new(), paths),
            _ => at += 1,
        }
    }
}

/// The path that starts at an identifier; returns the place after it.
fn collect_path(trees: &[TokenTree], start: usize, mut path: Vec<String>, paths: &mut BTreeSet<Vec<String>>) -> usize {
    let mut at = start;
    while let Some(TokenTree::Ident(ident)) = trees.get(at) {
        path.push(ident.to_string());
        at += 1;
        if !is_colons(trees, at) {
            break;
        }
        match trees.get(at + 2) {
            Some(TokenTree::Ident(_)) => at += 2,
            Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace => {
                let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                for piece in inner.split(|tree| matches!(tree, TokenTree::Punct(comma) if comma.as_char() == ',')) {
                    collect_path(piece, 0, path.clone(), paths);
                }
                return at + 3;
            }
            _ => break,
        }
    }
    let bang = matches!(trees.get(at), Some(TokenTree::Punct(bang)) if bang.as_char() == '!');
    let called =
        bang || matches!(trees.get(at), Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Parenthesis);
    let is_type = path.len() == 1 && path[0].starts_with(char::is_uppercase);
    // A lone name in lower case is a local one unless it is called.
    if path.len() > 1 || called || is_type {
        if bang && path.len() == 1 {
            let name = &path[0];
            paths.insert(vec![format!("{name}!")]);
        }
        paths.insert(path);
    }
    at
}

fn is_colons(trees: &[TokenTree], at: usize) -> bool {
    let colon = |at| matches!(trees.get(at), Some(TokenTree::Punct(colon)) if colon.as_char() == ':');
    colon(at) && colon(at + 1)
}

/// Paths in the strings of an attribute, as in `#[serde(with = "crate::a")]`; documentation has none.
fn strings(attribute: &TokenStream, paths: &mut BTreeSet<Vec<String>>) {
    let text = attribute.to_string();
    if text.starts_with("doc") {
        return;
    }
    for piece in text.split('"').skip(1).step_by(2) {
        let path: Vec<String> = piece.split("::").map(str::to_owned).collect();
        if path.len() > 1 {
            paths.insert(path);
        }
    }
}

/// The place after the item, field or statement that starts at a place.
fn after_item(trees: &[TokenTree], start: usize) -> usize {
    let mut at = start;
    while let Some((_, next)) = attribute(trees, at) {
        at = next;
    }
    let is_import = matches!(trees.get(at), Some(TokenTree::Ident(word)) if word == "use");
    while let Some(tree) = trees.get(at) {
        at += 1;
        match tree {
            TokenTree::Punct(end) if matches!(end.as_char(), ';' | ',') => return at,
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace && !is_import => return at,
            _ => {}
        }
    }
    at
}
