//! The command line as pages, services and containers use it: all that they say must be understood.

use super::Cli;
use clap::Parser;
use serde::Deserialize;
use std::path::Path;

#[path = "../../tests/docs/blocks.rs"]
#[expect(dead_code, reason = "the suite that runs the commands needs others of them")]
mod blocks;

#[test]
fn the_commands_in_the_pages_are_understood() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut count = 0;
    for block in blocks::pages(root).into_iter().flat_map(|page| page.blocks) {
        for line in block.text.replace("\\\n", " ").lines() {
            let words = shlex::split(line).unwrap_or_else(|| panic!("{}: quotes in {line}", block.place));
            let is_end = |word: &String| matches!(word.as_str(), "|" | ">" | "&" | "&&" | ";" | "||");
            for command in words.split(is_end) {
                let Some(args) = program(command) else { continue };
                count += 1;
                let parsed = Cli::try_parse_from(std::iter::once("cyclorama").chain(args.iter().map(String::as_str)));
                // Asking for help or the version is "an error" that ends well.
                if let Err(error) = parsed
                    && error.exit_code() != 0
                {
                    panic!("{}: {line}\n{error}", block.place);
                }
            }
        }
    }
    assert!(count > 30, "{count} commands found");
}

/// Within their text commands may lack something that has to be given, but nothing in them may be unknown.
#[test]
fn the_commands_in_the_text_of_pages_are_understood() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut count = 0;
    for (place, code) in blocks::pages(root).into_iter().flat_map(|page| page.spans) {
        let words = shlex::split(&code).unwrap_or_default();
        let Some(args) = program(&words) else { continue };
        if code.contains('…') {
            continue;
        }
        count += 1;
        let parsed = Cli::try_parse_from(std::iter::once("cyclorama").chain(args.iter().map(String::as_str)));
        if let Err(error) = parsed {
            use clap::error::ErrorKind::{
                DisplayHelp, DisplayHelpOnMissingArgumentOrSubcommand, MissingRequiredArgument,
            };
            let is_half = [DisplayHelp, DisplayHelpOnMissingArgumentOrSubcommand, MissingRequiredArgument];
            assert!(is_half.contains(&error.kind()), "{place}: {code}\n{error}");
        }
    }
    assert!(count > 20, "{count} commands found");
}

/// Claims name tests: suites by their folder, tests by a part of their path.
#[test]
fn the_tests_that_pages_name_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut names = String::new();
    for folder in ["proto", "manager", "channel", "compositor", "deploy", "tests"] {
        gather(&root.join(folder), &mut names);
    }
    let mut count = 0;
    for (place, code) in blocks::pages(root).into_iter().flat_map(|page| page.spans) {
        let Some(args) = code.strip_prefix("cargo test ") else { continue };
        count += 1;
        let mut words = args.split_whitespace();
        while let Some(word) = words.next() {
            match word {
                "-p" => assert!(words.next().is_some_and(|name| name.starts_with("cyclorama")), "{place}: {code}"),
                "--test" => {
                    let suite = words.next().unwrap();
                    assert!(names.contains(&format!("suite {suite}\n")), "{place}: no suite {suite}");
                }
                _ if word.starts_with('-') => {}
                _ => {
                    for part in word.split("::") {
                        let is_it = |line: &str| !line.starts_with("suite ") && line.contains(part);
                        assert!(names.lines().any(is_it), "{place}: no test {word}");
                    }
                }
            }
        }
    }
    assert!(count > 20, "{count} commands found");
}

/// Names of functions and modules below a folder, and of suites: folders, or files in a folder `tests`.
fn gather(folder: &Path, names: &mut String) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap();
        if path.is_dir() {
            names.push_str(&format!("suite {stem}\n"));
            gather(&path, names);
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            if folder.ends_with("tests") {
                names.push_str(&format!("suite {stem}\n"));
            }
            let text = std::fs::read_to_string(&path).unwrap();
            for line in text.lines().map(str::trim_start) {
                let line = line.strip_prefix("pub(crate) ").or(line.strip_prefix("async ")).unwrap_or(line);
                if let Some(rest) = line.strip_prefix("fn ").or(line.strip_prefix("mod ")) {
                    names.push_str(rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap());
                    names.push('\n');
                }
            }
        }
    }
}

/// Services, containers and pods start the program with arguments; those with a variable in them get some value.
#[test]
fn what_services_and_containers_say_is_understood() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut commands = Vec::new();
    for entry in std::fs::read_dir(folder.join("systemd")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let lines = text.lines().filter_map(|line| line.strip_prefix("ExecStart=/usr/bin/cyclorama "));
        commands.extend(lines.map(|line| (path.clone(), shlex::split(line).unwrap())));
    }
    let manifests = ["base/manager", "base/board", "base/compositor", "trial/host"];
    let manifests = manifests.map(|name| format!("kubernetes/{name}.yaml"));
    for name in manifests.iter().map(String::as_str).chain(["compose.yaml"]) {
        let path = folder.join(name);
        let text = std::fs::read_to_string(&path).unwrap();
        for document in serde_yaml_ng::Deserializer::from_str(&text) {
            let document = serde_json::Value::deserialize(document).unwrap();
            collect(&document, &mut |args| commands.push((path.clone(), args)));
        }
    }
    assert!(commands.len() >= 14, "{commands:?}");
    for (path, args) in commands {
        let args = args.iter().map(|word| filled(word));
        if let Err(error) = Cli::try_parse_from(std::iter::once("cyclorama".to_owned()).chain(args)) {
            panic!("{}: {error}", path.display());
        }
    }
}

/// With its variable's default, as in `${SIZE:-640x360}`, or some name.
fn filled(word: &str) -> String {
    let Some((before, variable)) = word.split_once('$') else { return word.to_owned() };
    let (variable, after) = variable.split_once(['}', ')']).unwrap();
    let (_, default) = variable.split_once(":-").unwrap_or((variable, "name"));
    format!("{before}{default}{after}")
}

/// Arguments of the program in a description of containers: what is run, and what they are asked by.
fn collect(value: &serde_json::Value, found: &mut impl FnMut(Vec<String>)) {
    let words = |value: &serde_json::Value| -> Vec<String> {
        value.as_array().into_iter().flatten().filter_map(|word| word.as_str().map(str::to_owned)).collect()
    };
    if let Some(fields) = value.as_object() {
        for (key, value) in fields {
            let said = words(value);
            let own = said.iter().position(|word| word == "/cyclorama").map_or(0, |at| at + 1);
            match key.as_str() {
                "args" | "command" | "entrypoint" | "test" if said.len() > own => found(said[own..].to_vec()),
                _ => collect(value, found),
            }
        }
    }
    value.as_array().into_iter().flatten().for_each(|value| collect(value, found));
}

/// The arguments, if this command is ours.
fn program(command: &[String]) -> Option<&[String]> {
    let is_assignment = |word: &&String| word.starts_with("CYCLORAMA_") && word.contains('=');
    let command = &command[command.iter().take_while(is_assignment).count()..];
    match command {
        [first, rest @ ..] if first == "cyclorama" => Some(rest),
        // Another package's program isn't ours.
        [first, second, rest @ ..] if first == "cargo" && second == "run" && !rest.iter().any(|word| word == "-p") => {
            Some(rest.iter().position(|word| word == "--").map_or(&[], |at| &rest[at + 1..]))
        }
        _ => None,
    }
}
