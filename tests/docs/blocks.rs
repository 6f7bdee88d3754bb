//! The shell commands in the pages: fenced `sh` blocks, as a reader copies them.

use std::path::{Path, PathBuf};

/// A comment with this in the line above a block says why no test can run it.
const NOT_RUN: &str = "<!-- not run: ";

/// A fenced block.
#[derive(Debug)]
pub(crate) struct Block {
    /// `docs/keys.md:9`, the line where it begins.
    pub place: String,
    pub text: String,
    /// Why it can't be run in a test.
    pub not_run: Option<String>,
}

/// A page, with its blocks and what is code within its text, in order.
#[derive(Debug)]
pub(crate) struct Page {
    pub name: String,
    pub blocks: Vec<Block>,
    /// By place: `docs/keys.md:9`.
    pub spans: Vec<(String, String)>,
}

/// README.md and the pages of docs/.
pub(crate) fn pages(root: &Path) -> Vec<Page> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(root.join("docs")).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|kind| kind == "md"));
    files.push(root.join("README.md"));
    files.sort();
    let page = |file: PathBuf| {
        let name = file.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
        let text = std::fs::read_to_string(&file).unwrap();
        Page { blocks: blocks(&name, &text), spans: spans(&name, &text), name }
    };
    files.into_iter().map(page).collect()
}

fn blocks(name: &str, text: &str) -> Vec<Block> {
    let mut found = Vec::new();
    let mut lines = (1..).zip(text.lines());
    let mut above = "";
    while let Some((number, line)) = lines.next() {
        if line.trim_end() == "```sh" {
            let body: Vec<_> =
                lines.by_ref().map(|(_, line)| line).take_while(|line| line.trim_end() != "```").collect();
            let not_run = above.strip_prefix(NOT_RUN).map(|why| why.trim_end_matches("-->").trim().to_owned());
            found.push(Block { place: format!("{name}:{number}"), text: body.join("\n") + "\n", not_run });
        }
        above = line;
    }
    found
}

fn spans(name: &str, text: &str) -> Vec<(String, String)> {
    let mut is_block = false;
    let mut found = Vec::new();
    // What began in one line may end in the next.
    let mut open = String::new();
    for (number, line) in (1..).zip(text.lines()) {
        let is_fence = line.starts_with("```");
        is_block ^= is_fence;
        if is_block || is_fence || line.is_empty() {
            open.clear();
            continue;
        }
        open.push_str(line);
        if open.matches('`').count() % 2 == 1 {
            open.push(' ');
            continue;
        }
        let code = open.split('`').skip(1).step_by(2);
        found.extend(code.map(|code| (format!("{name}:{number}"), code.to_owned())));
        open.clear();
    }
    found
}
