//! Links of the built book: each leads to a file, and where it names a place, to that place on the page.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, ensure};

/// Follows the links of all pages in a folder; those to other sites are left alone.
pub(crate) fn check(folder: &Path) -> anyhow::Result<()> {
    let mut pages = BTreeMap::new();
    read_pages(folder, &mut pages)?;
    let mut dead = Vec::new();
    let mut followed = 0;
    for (page, text) in &pages {
        for link in values(text, "href").chain(values(text, "src")) {
            if link.split(['/', '#']).next().is_some_and(|start| start.contains(':')) {
                continue;
            }
            followed += 1;
            if !leads_somewhere(folder, &pages, page, link) {
                dead.push(format!("{}: {link}", page.display()));
            }
        }
    }
    ensure!(dead.is_empty(), "links that lead nowhere:\n{}", dead.join("\n"));
    eprintln!("{followed} links on {} pages lead somewhere", pages.len());
    Ok(())
}

fn read_pages(folder: &Path, pages: &mut BTreeMap<PathBuf, String>) -> anyhow::Result<()> {
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            read_pages(&path, pages)?;
        } else if path.extension().is_some_and(|extension| extension == "html") {
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            pages.insert(path, text);
        }
    }
    Ok(())
}

/// Values of an attribute.
fn values<'a>(text: &'a str, attribute: &str) -> impl Iterator<Item = &'a str> + use<'a> {
    let begin = format!(" {attribute}=\"");
    let places: Vec<_> = text.match_indices(&begin).map(|(at, _)| at + begin.len()).collect();
    places
        .into_iter()
        .filter_map(|at| text[at..].split_once('"').map(|(value, _)| value))
}

fn leads_somewhere(folder: &Path, pages: &BTreeMap<PathBuf, String>, page: &Path, link: &str) -> bool {
    let (path, place) = link.split_once('#').unwrap_or((link, ""));
    // The page for an address that is none does not know how deep it is: its links begin at the root.
    let from = if page.ends_with("404.html") {
        Some(folder)
    } else {
        page.parent()
    };
    let mut target = match (path, from) {
        ("", _) => page.to_owned(),
        (_, Some(from)) => normal(&from.join(path.trim_start_matches('/'))),
        (_, None) => return false,
    };
    if target.is_dir() {
        target.push("index.html");
    }
    match pages.get(&target) {
        Some(text) if !place.is_empty() => values(text, "id").any(|id| id == place),
        Some(_) => true,
        None => place.is_empty() && target.is_file(),
    }
}

/// Without what goes up again.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                normal.pop();
            }
            part => normal.push(part),
        }
    }
    normal
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_leads_to_a_page_and_to_a_place_on_it() {
        let folder = Path::new("/book");
        let pages: BTreeMap<_, _> = [
            ("/book/a.html", "<h1 id=\"top\"> <a href=\"b/c.html#x\">"),
            ("/book/b/c.html", "<p id=\"x\">"),
        ]
        .map(|(path, text)| (PathBuf::from(path), text.to_owned()))
        .into();
        let leads = |page: &str, link| leads_somewhere(folder, &pages, Path::new(page), link);
        for link in ["#top", "b/c.html", "b/c.html#x", "b/../a.html"] {
            assert!(leads("/book/a.html", link), "{link}");
        }
        assert!(leads("/book/b/c.html", "../a.html#top") && leads("/book/404.html", "b/c.html"));
        for link in ["#x", "c.html", "b/c.html#y", "b/c.txt"] {
            assert!(!leads("/book/a.html", link), "{link}");
        }
        assert_eq!(
            values(&pages[Path::new("/book/a.html")], "href").collect::<Vec<_>>(),
            ["b/c.html#x"]
        );
    }
}
