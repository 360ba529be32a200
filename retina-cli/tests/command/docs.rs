//! The documentation: its links lead somewhere, and its commands and options exist.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::retina;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// README, ARCHITECTURE and the guides.
fn pages() -> Vec<(PathBuf, String)> {
    let names = ["README.md", "ARCHITECTURE.md", "STYLE.md", "VALIDATION.md", "validation/README.md"];
    let mut files: Vec<PathBuf> = names.into_iter().map(|name| root().join(name)).collect();
    files.extend(fs::read_dir(root().join("docs")).unwrap().map(|entry| entry.unwrap().path()));
    files.retain(|file| file.extension().is_some_and(|extension| extension == "md"));
    files.sort();
    files.into_iter().map(|file| (file.clone(), fs::read_to_string(file).unwrap())).collect()
}

/// Names under which headings can be linked to, as GitHub makes them.
fn anchors(text: &str) -> Vec<String> {
    let headings =
        text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    headings
        .map(|heading| {
            let kept = heading
                .to_lowercase()
                .chars()
                .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
                .collect::<String>();
            kept.replace(' ', "-")
        })
        .collect()
}

#[test]
fn links_lead_somewhere() {
    let mut broken = Vec::new();
    let mut checked = 0;
    for (file, text) in pages() {
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.starts_with("http") || link.contains(' ') || link.is_empty() {
                continue;
            }
            let (path, anchor) =
                link.split_once('#').map_or((link, None), |(path, anchor)| (path, Some(anchor)));
            let target = if path.is_empty() { file.clone() } else { file.parent().unwrap().join(path) };
            checked += 1;
            let found = match anchor {
                None => target.exists(),
                Some(anchor) => fs::read_to_string(&target)
                    .is_ok_and(|text| anchors(&text).iter().any(|own| own == anchor)),
            };
            if !found {
                broken.push(format!("{}: {link}", file.display()));
            }
        }
    }
    assert!(checked > 30, "{checked}");
    assert!(broken.is_empty(), "{broken:#?}");
}

/// The help of a command, its own subcommands after it.
fn help(words: &[&str], known: &mut BTreeMap<String, Option<String>>) -> Option<String> {
    let name = words.join(" ");
    known
        .entry(name)
        .or_insert_with(|| {
            let output = retina().args(words).arg("--help").output().unwrap();
            output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
        })
        .clone()
}

/// A line of a fenced block, with what is continued by a backslash.
fn commands(text: &str) -> Vec<String> {
    let (mut inside, mut out, mut open): (bool, Vec<String>, Option<String>) = (false, Vec::new(), None);
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
            open = None;
            continue;
        }
        if !inside {
            continue;
        }
        let line = line.trim();
        let whole = match open.take() {
            Some(before) => format!("{before} {line}"),
            None if line.starts_with("retina ") => line.to_owned(),
            None => continue,
        };
        match whole.strip_suffix('\\') {
            Some(before) => open = Some(before.trim().to_owned()),
            None => out.push(whole),
        }
    }
    out
}

#[test]
fn commands_and_options_exist() {
    let mut known = BTreeMap::new();
    let mut wrong = Vec::new();
    let mut checked = 0;
    for (file, text) in pages() {
        for command in commands(&text) {
            // A comment, a quoted command of another program, and what follows a choice are not the command itself.
            let own = command.split(" #").next().unwrap_or_default().split('\'').next().unwrap_or_default();
            let words: Vec<&str> = own.split_whitespace().skip(1).collect();
            let first = words.first().copied().unwrap_or_default();
            if first.is_empty() || first.starts_with('-') || first.contains(['|', 'C']) {
                continue;
            }
            let mut path = vec![first];
            let Some(mut text) = help(&path, &mut known) else {
                wrong.push(format!("{}: {command}", file.display()));
                continue;
            };
            // Subcommands, as deep as there are any.
            for word in
                words.iter().skip(1).filter(|word| word.chars().all(|c| c.is_ascii_lowercase() || c == '-'))
            {
                if !text.contains("\nCommands:") {
                    break;
                }
                path.push(word);
                match help(&path, &mut known) {
                    Some(own) => text = own,
                    None => break,
                }
            }
            checked += 1;
            for option in words
                .iter()
                .map(|word| word.trim_matches(['[', ']', '(', ')']))
                .filter(|word| word.starts_with("--"))
            {
                let name = option.split(['=', '|']).next().unwrap_or_default();
                if !text.contains(name) {
                    wrong.push(format!("{}: {command}: {name}", file.display()));
                }
            }
        }
    }
    assert!(checked > 80, "{checked}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}
