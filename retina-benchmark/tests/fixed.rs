//! A fixed part of the benchmark: one round of forty sets.

use std::path::Path;

use retina_benchmark::{generate, run, score};

const SEED: u64 = 1;
const SETS: usize = 40;

/// The truth is the one that was sealed, and the workbench meets it as far as forty sets can tell.
#[test]
fn a_round_of_forty_sets() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = tempfile::tempdir().unwrap();
    let hash = generate(folder.path(), SEED, SETS, None).unwrap();
    let sealed = std::fs::read_to_string(root.join("tests/benchmark/truth.txt")).unwrap();
    assert!(
        sealed.lines().any(|line| line == format!("seed {SEED}, {SETS} sets: {hash}")),
        "{hash} is not the sealed truth"
    );
    run(folder.path(), &root.join("assets/setups/wide-fov.toml"), None, |_, _, _| ()).unwrap();
    let outcome = score(folder.path()).unwrap();
    println!("{}", outcome.markdown);
    let missed = |words: &str| -> usize {
        let targets: Vec<_> = outcome.targets.iter().filter(|t| t.name.contains(words)).collect();
        assert!(targets.iter().any(|t| t.of > 0), "{words}");
        targets.iter().map(|t| if t.wanted.1 { t.of - t.count } else { t.count }).sum()
    };
    // Twelve nulls: at a rate of 3.5 % more than two alarms come by chance in 1 %.
    assert!(missed("false alarms, jitter") <= 2);
    assert!(missed("wrong class") == 0);
    assert!(missed("exact name, outside") <= 1);
    assert!(missed("class, not larger") <= 1);
    assert!(missed("no second effect") <= 1);
    assert!(missed("truth inside the set") <= 1);
    assert!(missed("pairs: both classes") <= 1);
}

/// A run that was stopped half way through a line goes on, and finishes the same.
#[test]
fn a_run_that_was_stopped_goes_on() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let setup = root.join("assets/setups/wide-fov.toml");
    let folder = tempfile::tempdir().unwrap();
    // Phase curves alone: they are quick.
    generate(folder.path(), 5, 80, Some("phase")).unwrap();
    run(folder.path(), &setup, None, |_, _, _| ()).unwrap();
    let path = folder.path().join("results.jsonl");
    let whole = std::fs::read_to_string(&path).unwrap();
    let said = |text: &str| -> Vec<String> {
        let until = |line: &str| line.split(",\"seconds\"").next().unwrap_or_default().to_owned();
        let mut lines: Vec<String> = text.lines().map(until).collect();
        lines.sort();
        lines
    };
    assert_eq!(said(&whole).len(), 4);
    std::fs::write(&path, &whole[..whole.len() - 40]).unwrap();
    let mut open = 0;
    let told = std::sync::Mutex::new(&mut open);
    run(folder.path(), &setup, None, |_, total, _| {
        assert_eq!(total, 4);
        **told.lock().unwrap() += 1;
    })
    .unwrap();
    assert_eq!(open, 1);
    assert_eq!(said(&std::fs::read_to_string(&path).unwrap()), said(&whole));
    // In shards: the same lines, in lists of their own, and the same scores.
    let scored = score(folder.path()).unwrap().markdown;
    std::fs::remove_file(&path).unwrap();
    for part in ["0/3", "2/3", "1/3", "1/3"] {
        run(folder.path(), &setup, Some(part.parse().unwrap()), |_, _, _| ()).unwrap();
    }
    assert!(!path.exists());
    let lists = (0..3).map(|part| folder.path().join(format!("results-{part}-of-3.jsonl")));
    let all: String = lists.map(|list| std::fs::read_to_string(list).unwrap()).collect();
    assert_eq!(said(&all), said(&whole));
    assert_eq!(score(folder.path()).unwrap().markdown, scored);
}
