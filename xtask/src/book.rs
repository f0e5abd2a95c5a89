//! The book in `docs`: built without a warning, its links followed, and the commands on its pages run, their output compared.
//!
//! What a page's code blocks mean:
//!
//! | block | meaning |
//! |---|---|
//! | `console` | a command after `$ `, what it prints, `[n]` for an exit code; run in order, in a fresh folder for each page |
//! | `toml` below a line `<!-- NAME -->` | the file of this name, written before the commands that follow |
//! | `sh` below a line `<!-- not run: WHY -->` | commands that cannot run here; reported |
//!
//! In what is printed, `...` stands for anything within a line, alone on a line for any lines.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};

use crate::links;
use crate::programs::Programs;
use crate::shell::{program, root, run, target_dir};
use crate::tools::Tool;

const MDBOOK: Tool = Tool {
    krate: "mdbook",
    version: "0.5.4",
    program: "mdbook",
    options: &["--no-default-features", "--features", "search"],
};

/// Runs what stands in a page and compares what it prints.
const SCRUT: Tool = Tool {
    krate: "scrut",
    version: "0.4.3",
    program: "scrut",
    options: &[],
};

/// The page with a table of all verbs.
const COMMAND_LINE: &str = "cli.md";

/// Checks the book; with `update`, the pages get what their commands print now.
pub(crate) fn check(update: bool) -> anyhow::Result<()> {
    let pages = pages()?;
    let programs = Programs::build()?;
    let folder = target_dir()?.join("book-pages");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let mut documents = Vec::new();
    for page in &pages {
        let name = page.file_name().unwrap_or_default().display();
        let document = to_document(&read(page)?).with_context(|| name.to_string())?;
        for why in &document.not_run {
            eprintln!("{name}: not run: {why}");
        }
        if document.commands > 0 {
            let path = folder.join(page.file_name().unwrap_or_default());
            fs::write(&path, &document.text).with_context(|| path.display().to_string())?;
            documents.push((page, path));
        }
    }
    let scrut = SCRUT.path()?;
    for (page, path) in &documents {
        let verb: &[&str] = if update {
            &["update", "--replace", "--assume-yes"]
        } else {
            &["test"]
        };
        run(program(&scrut, verb)
            .arg("--combine-output")
            .arg(path)
            .env("PATH", path_with(&programs)?)
            .env("HMD", root()))?;
        if update {
            fs::write(page, from_document(&read(path)?)).with_context(|| page.display().to_string())?;
        }
    }
    every_verb_has_its_row(&programs)?;
    build()
}

/// The pages that the table of contents names.
fn pages() -> anyhow::Result<Vec<PathBuf>> {
    let docs = root().join("docs");
    let contents = read(&docs.join("SUMMARY.md"))?;
    let named = contents.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    let pages: Vec<PathBuf> = named.map(|(name, _)| docs.join(name)).collect();
    for file in fs::read_dir(&docs)? {
        let path = file?.path();
        let is_page = path.extension().is_some_and(|extension| extension == "md") && !path.ends_with("SUMMARY.md");
        ensure!(
            !is_page || pages.contains(&path),
            "docs/SUMMARY.md: expected all pages, {} is not there",
            path.display()
        );
    }
    Ok(pages)
}

/// A page in the form of the program that runs it.
struct Document {
    text: String,
    commands: usize,
    /// Why commands are not run.
    not_run: Vec<String>,
}

/// Lines between these are of the form alone.
const WRITTEN: (&str, &str) = ("<!-- begin file -->", "<!-- end file -->");

fn to_document(page: &str) -> anyhow::Result<Document> {
    let mut document = Document {
        text: String::new(),
        commands: 0,
        not_run: Vec::new(),
    };
    let mut lines = page.lines();
    let mut comment = None;
    while let Some(line) = lines.next() {
        let Some(language) = line.strip_prefix("```") else {
            document.put(line);
            comment = line.strip_prefix("<!-- ").and_then(|rest| rest.strip_suffix(" -->"));
            continue;
        };
        let block: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
        match (language, comment) {
            ("console", _) => {
                document.commands += 1;
                document.put("```scrut");
                for line in &block {
                    document.put(&expectation(line));
                }
            }
            ("toml", Some(name)) => {
                document.put(WRITTEN.0);
                document.put(&format!("```scrut\n$ cat > {name} <<'END'"));
                for line in &block {
                    document.put(&format!("> {line}"));
                }
                document.put(&format!("> END\n```\n{}\n{line}", WRITTEN.1));
                block.iter().for_each(|line| document.put(line));
            }
            ("sh", Some(why)) if why.starts_with("not run: ") => {
                document.not_run.push(why.trim_start_matches("not run: ").to_owned());
                document.put(line);
                block.iter().for_each(|line| document.put(line));
            }
            ("sh", _) => bail!("expected <!-- not run: WHY --> above a block of sh, or console: {block:?}"),
            ("", _) if is_command(&block) && !comment.is_some_and(|command| command.starts_with("$ ")) => {
                bail!("expected a language of a block with commands: {block:?}")
            }
            _ => {
                document.put(line);
                block.iter().for_each(|line| document.put(line));
            }
        }
        document.put("```");
        comment = None;
    }
    Ok(document)
}

impl Document {
    fn put(&mut self, line: &str) {
        self.text += line;
        self.text.push('\n');
    }
}

/// Whether a block without a language has commands; those that `cargo xtask results` writes have a comment above.
fn is_command(block: &[&str]) -> bool {
    let first = block.first().copied().unwrap_or_default();
    ["$ ", "hmd ", "cargo "].iter().any(|begin| first.starts_with(begin))
}

/// A line of a `console` block: `...` becomes a wildcard, if it is no command.
fn expectation(line: &str) -> String {
    if line.starts_with("$ ") || line.starts_with("> ") || !line.contains("...") {
        line.to_owned()
    } else if line == "..." {
        "* (glob+)".to_owned()
    } else {
        format!("{} (glob)", line.replace("...", "*"))
    }
}

/// The page of a document whose output was brought up to date.
fn from_document(document: &str) -> String {
    let mut page = String::new();
    let mut lines = document.lines();
    while let Some(line) = lines.next() {
        if line == WRITTEN.0 {
            lines.by_ref().take_while(|line| *line != WRITTEN.1).for_each(drop);
            continue;
        }
        page += &match (line, line.strip_suffix(" (glob)")) {
            ("```scrut", _) => "```console".to_owned(),
            ("* (glob+)", _) => "...".to_owned(),
            (_, Some(pattern)) => pattern.replace('*', "..."),
            _ => line.to_owned(),
        };
        page.push('\n');
    }
    page
}

/// The freshly built program first.
fn path_with(programs: &Programs) -> anyhow::Result<OsString> {
    let others = env::var_os("PATH").unwrap_or_default();
    Ok(env::join_paths(
        std::iter::once(programs.folder().clone()).chain(env::split_paths(&others)),
    )?)
}

/// The table of verbs has a row for each verb of the program, and no other.
fn every_verb_has_its_row(programs: &Programs) -> anyhow::Result<()> {
    let help = program(programs.hmd(), ["--help"]).output()?;
    let help = String::from_utf8(help.stdout)?;
    let page = read(&root().join("docs").join(COMMAND_LINE))?;
    let (expected, found) = (verbs_of_help(&help), verbs_of_table(&page));
    ensure!(!expected.is_empty(), "hmd --help: expected verbs, found none");
    ensure!(
        expected == found,
        "docs/{COMMAND_LINE}: expected a row for each of {expected:?}, found {found:?}"
    );
    Ok(())
}

/// The verbs that a program's help lists, without `help` itself, in order.
fn verbs_of_help(help: &str) -> Vec<&str> {
    let verbs = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let verbs = verbs.take_while(|line| !line.is_empty());
    let names = verbs.filter_map(|line| line.split_whitespace().next());
    names.filter(|name| *name != "help").collect()
}

/// The first cells of the page's table of verbs, in order.
fn verbs_of_table(page: &str) -> Vec<&str> {
    let rows = page.lines().skip_while(|line| !line.starts_with("| verb |")).skip(2);
    let rows = rows.take_while(|line| line.starts_with('|'));
    let cells = rows.filter_map(|row| row.split('|').nth(1));
    cells.map(|cell| cell.trim().trim_matches('`')).collect()
}

/// Builds the pages; warnings count as errors, and so does a link that leads nowhere.
fn build() -> anyhow::Result<()> {
    let book = target_dir()?.join("book");
    let mut mdbook = program(MDBOOK.path()?, ["build", "docs", "--dest-dir"]);
    let built = mdbook.arg(&book).output().context("mdbook")?;
    let text = String::from_utf8_lossy(&built.stderr);
    eprint!("{text}");
    ensure!(built.status.success(), "mdbook: {}", built.status);
    ensure!(!text.contains("WARN"), "mdbook: expected no warning");
    links::check(&book)?;
    eprintln!("the book: {}", book.join("index.html").display());
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "# Page\n\n<!-- a.toml -->\n```toml\nid = 0\n\n```\n\n```console\n$ cat a.toml\nid = ...\n...\n```\n\n\
        <!-- not run: no bus -->\n```sh\ncandump can0\n```\n\n```\nno command\n```\n";

    #[test]
    fn a_page_becomes_a_document_and_a_page_again() {
        let document = to_document(PAGE).expect("a page");
        assert_eq!(
            (document.commands, document.not_run.as_slice()),
            (1, ["no bus".to_owned()].as_slice())
        );
        for expected in [
            "```scrut\n$ cat > a.toml <<'END'\n> id = 0\n> \n> END\n```\n",
            "```scrut\n$ cat a.toml\nid = * (glob)\n* (glob+)\n```\n",
            "```\nno command\n```\n",
        ] {
            assert!(document.text.contains(expected), "{expected} in\n{}", document.text);
        }
        assert_eq!(from_document(&document.text), PAGE);
    }

    #[test]
    fn verbs_are_read_from_help_and_table() {
        let help = "What it is\n\nCommands:\n  run     Watch\n  replay  Assess\n  help    Print\n\nOptions:\n  -h\n";
        let page = "| code | meaning |\n|---|---|\n| 0 | done |\n\n| verb | what |\n|---|---|\n| `run` | a |\n| `replay` | b |\n\n| c |\n";
        assert_eq!(verbs_of_help(help), ["run", "replay"]);
        assert_eq!(verbs_of_table(page), ["run", "replay"]);
    }

    #[test]
    fn commands_that_are_neither_run_nor_excused_are_refused() {
        for page in [
            "```sh\nhmd demo\n```\n",
            "```\nhmd demo\n```\n",
            "```\n$ hmd demo\n```\n",
        ] {
            assert!(to_document(page).is_err(), "{page}");
        }
        assert!(to_document("<!-- $ hmd demo -->\n```\n$ hmd demo\n```\n").is_ok());
    }
}
