//! The scorer: opens the truth and counts how often the workbench was right.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

use retina_files::InputError;
use serde_json::{Value, json};

use crate::algebra::{beside, rms};
use crate::forms::KNOWN;
use crate::generate::Derived;
use crate::lists::finished;
use crate::plan::{Kind, Plan, class_of};
use crate::points::baseline_of_table;
use crate::run::{Finished, LIST, Said};

/// An effect weaker than this many sigmas to who knows its form cannot be found among all candidates.
pub(crate) const FINDABLE_SIGMA: f64 = 4.0;

/// A target with what was found.
#[derive(Debug, Clone)]
pub struct Target {
    /// What is counted.
    pub name: String,
    /// Sets in which it was so.
    pub count: usize,
    /// Sets that were looked at.
    pub of: usize,
    /// The share that is wanted; `true`: at least.
    pub wanted: (f64, bool),
}

/// All targets, and the tables.
pub struct Outcome {
    /// The targets.
    pub targets: Vec<Target>,
    /// As JSON, schema `retina.benchmark/1`.
    pub json: Value,
    /// As Markdown.
    pub markdown: String,
}

impl Target {
    /// The share that was found.
    pub fn share(&self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }

    /// Whether the share is as wanted; true where nothing was counted.
    pub fn met(&self) -> bool {
        self.of == 0
            || if self.wanted.1 { self.share() >= self.wanted.0 } else { self.share() <= self.wanted.0 }
    }

    /// Upper 95 % bound of the share (E. B. Wilson, JASA 22, 1927).
    pub(crate) fn upper(&self) -> f64 {
        let (n, z) = (self.of.max(1) as f64, 1.645);
        let p = self.share();
        let centre = p + z * z / (2.0 * n);
        (centre + z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt()) / (1.0 + z * z / n)
    }
}

struct Set {
    plan: Plan,
    derived: Derived,
    found: Finished,
}

impl Set {
    fn said(&self) -> &Said {
        &self.found.said
    }

    fn id(&self) -> &str {
        self.plan.hidden.first().map_or("", |h| h.id.as_str())
    }

    fn strength(&self) -> f64 {
        self.plan.hidden.first().map_or(0.0, |h| h.strength)
    }

    fn classed(&self) -> bool {
        class_of(self.id()).len() > 1
    }

    /// Whether one who knows the form would see each effect.
    fn findable(&self) -> bool {
        self.derived.oracle_sigma.iter().all(|z| *z >= FINDABLE_SIGMA)
    }

    fn exact(&self) -> bool {
        self.said().verdict == "named" && self.said().accepted == [self.id()]
    }

    /// The class, whole and not larger; of a single effect, that alone.
    fn class_found(&self) -> bool {
        let class = class_of(self.id());
        let set = &self.said().indistinguishable;
        set.iter().any(|id| id == self.id()) && set.iter().all(|id| class.contains(&id.as_str()))
    }

    fn detected(&self) -> bool {
        self.said().verdict != "adequate"
    }
}

pub(crate) fn lines<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Vec<T>, InputError> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| InputError::new(path, format!("cannot be read: {error}")))?;
    text.lines()
        .enumerate()
        .map(|(k, line)| {
            serde_json::from_str(line).map_err(|error| {
                InputError::new(path, "holds a line that is none")
                    .at(format!("line {}", k + 1))
                    .found(error.to_string())
            })
        })
        .collect()
}

/// Numbers of a single-precision file.
pub(crate) fn numbers(path: &Path) -> Option<Vec<f64>> {
    let bytes = std::fs::read(path).ok()?;
    Some(bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect())
}

/// Predicted minus true field beside the baseline, over the true one's rms.
pub(crate) fn field_error(folder: &Path, set: usize) -> Option<f64> {
    let truth = numbers(&folder.join("sealed").join(format!("{set:05}.f32")))?;
    let px = numbers(&folder.join("predicted").join(format!("{set:05}.f32")))?;
    let table =
        std::fs::read_to_string(folder.join("sets").join(format!("{set:05}")).join("table.csv")).ok()?;
    let (base, arcsec_per_px) = baseline_of_table(&table);
    let ones = vec![1.0; truth.len()];
    let difference: Vec<f64> = px.iter().zip(&truth).map(|(p, t)| p * arcsec_per_px - t).collect();
    let own = rms(&beside(&base, &truth, &ones));
    Some(rms(&beside(&base, &difference, &ones)) / own)
}

/// Opens the truth of a folder and scores its results.
///
/// # Errors
/// A file cannot be read.
pub fn score(folder: &Path) -> Result<Outcome, InputError> {
    let plans: Vec<Plan> = lines(&folder.join("sealed").join("truth.jsonl"))?;
    let derived: Vec<Derived> = lines(&folder.join("sealed").join("derived.jsonl"))?;
    let mut truth: HashMap<usize, (Plan, Derived)> =
        plans.into_iter().zip(derived).map(|(p, d)| (p.set, (p, d))).collect();
    let mut results: Vec<Finished> = finished(folder, LIST)?;
    results.sort_by_key(|f| f.set);
    let sets: Vec<Set> = results
        .into_iter()
        .filter_map(|found| {
            let (plan, derived) = truth.remove(&found.set)?;
            Some(Set { plan, derived, found })
        })
        .collect();
    let targets = targets(folder, &sets);
    let markdown = markdown(&sets, &targets);
    let json = json!({
        "schema": "retina.benchmark/1",
        "sets": sets.len(),
        "targets": targets.iter().map(|t| json!({
            "name": t.name, "count": t.count, "of": t.of, "share": t.share(),
            "upper_95": t.upper(), "wanted": t.wanted.0, "at_least": t.wanted.1, "met": t.met(),
        })).collect::<Vec<_>>(),
        "null_p_uniform": uniformity(&sets).map(|(n, d, p)| json!({ "sets": n, "kolmogorov": d, "p_value": p })),
    });
    Ok(Outcome { targets, json, markdown })
}

fn targets(folder: &Path, sets: &[Set]) -> Vec<Target> {
    let mut out = Vec::new();
    let mut count =
        |name: &str, wanted: (f64, bool), within: &dyn Fn(&Set) -> bool, good: &dyn Fn(&Set) -> bool| {
            let looked: Vec<&Set> = sets.iter().filter(|s| within(s)).collect();
            out.push(Target {
                name: name.to_owned(),
                count: looked.iter().filter(|s| good(s)).count(),
                of: looked.len(),
                wanted,
            });
        };
    let (least, most) = (true, false);
    let null = |s: &Set| s.plan.kind == Kind::Null;
    let single = |s: &Set| s.plan.kind == Kind::Single && s.findable();
    let scalar = |s: &Set| matches!(s.plan.kind, Kind::Power | Kind::Phase);
    count(
        "false alarms, jitter 0.3 sigma or less",
        (0.05, most),
        &|s| null(s) && s.plan.campaign.jitter <= 0.3,
        &|s| s.detected(),
    );
    count(
        "false alarms, jitter above 0.3, to 1 sigma",
        (0.05, most),
        &|s| null(s) && s.plan.campaign.jitter > 0.3,
        &|s| s.detected(),
    );
    count(
        "findable by an oracle (form and noise known, 4 sigma)",
        (0.0, least),
        &|s| s.plan.kind == Kind::Single,
        &|s| s.findable(),
    );
    for (strength, wanted) in [(0.1, 0.8), (0.3, 0.95), (1.0, 0.95), (3.0, 0.95), (10.0, 0.95)] {
        let here = move |s: &Set| single(s) && (s.strength() - strength).abs() < 1e-9;
        count(
            &format!("exact name, outside the classes, strength {strength}"),
            (wanted, least),
            &|s| here(s) && !s.classed(),
            &Set::exact,
        );
        count(
            &format!("class, not larger, strength {strength}"),
            (wanted, least),
            &|s| here(s) && s.classed(),
            &Set::class_found,
        );
        count(
            &format!("no second effect, strength {strength}"),
            (0.95, least),
            &|s| here(s) && s.detected(),
            &|s| s.said().accepted.len() <= 1,
        );
        count(
            &format!("nothing left unexplained, strength {strength}"),
            (0.95, least),
            &|s| here(s) && s.detected(),
            &|s| s.said().unexplained.is_empty(),
        );
    }
    let strong = |s: &Set| single(s) && s.strength() >= 0.3;
    count("wrong class, strength 0.3 and above", (0.01, most), &|s| strong(s) && s.detected(), &|s| {
        let class = class_of(s.id());
        s.said().accepted.first().is_some_and(|id| !class.contains(&id.as_str()))
    });
    count(
        "truth inside the set, given detection",
        (0.95, least),
        &|s| single(s) && !s.said().accepted.is_empty(),
        &|s| s.said().indistinguishable.iter().any(|id| id == s.id()),
    );
    count(
        "outside effects: unknown",
        (0.9, least),
        &|s| s.plan.kind == Kind::Outside && s.findable(),
        &|s| s.said().verdict == "unknown",
    );
    count(
        "outside effects: unknown, with the right column",
        (0.9, least),
        &|s| s.plan.kind == Kind::Outside && s.findable(),
        &|s| {
            s.said().verdict == "unknown"
                && s.plan.covariates.iter().all(|c| s.said().unexplained.contains(c))
        },
    );
    count(
        "pairs: both classes and no other",
        (0.9, least),
        &|s| s.plan.kind == Kind::Pair && s.findable(),
        &|s| {
            let classes: Vec<Vec<&str>> = s.plan.hidden.iter().map(|h| class_of(&h.id)).collect();
            let accepted = &s.said().accepted;
            accepted.len() == 2
                && classes.iter().all(|class| accepted.iter().any(|id| class.contains(&id.as_str())))
        },
    );
    count(
        "confounded pairs: a follow-up is proposed and was made",
        (0.95, least),
        &|s| s.plan.kind == Kind::Confounded && s.findable(),
        &|s| s.found.follow_up.is_some(),
    );
    count(
        "after the follow-up: exact",
        (0.95, least),
        &|s| s.plan.kind == Kind::Confounded && s.found.follow_up.is_some(),
        &|s| {
            s.found
                .follow_up
                .as_ref()
                .is_some_and(|f| f.accepted == [s.id()] && f.indistinguishable == [s.id()])
        },
    );
    count(
        "predicted field within 0.3 of its rms, strength 0.3 and above",
        (0.95, least),
        &|s| strong(s) && !s.said().accepted.is_empty() && s.plan.campaign.rows <= 2000,
        &|s| field_error(folder, s.plan.set).is_some_and(|e| e <= 0.3),
    );
    count("power and phase: false alarms", (0.05, most), &|s| scalar(s) && s.plan.hidden.is_empty(), &|s| {
        s.detected()
    });
    count(
        "power and phase: in the set, nothing else accepted",
        (0.9, least),
        &|s| scalar(s) && !s.plan.hidden.is_empty() && s.strength() >= 1.0,
        &|s| s.said().indistinguishable.iter().any(|id| id == s.id()) && s.said().accepted.len() == 1,
    );
    out
}

/// Kolmogorov's distance of null p-values from uniform ones, and its p-value; p-values are multiples of 1 / 2000.
fn uniformity(sets: &[Set]) -> Option<(usize, f64, f64)> {
    let mut p: Vec<f64> = sets.iter().filter(|s| s.plan.kind == Kind::Null).map(|s| s.said().p).collect();
    if p.len() < 10 {
        return None;
    }
    p.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    let distance = p
        .iter()
        .enumerate()
        .map(|(i, p)| (p - i as f64 / n).abs().max((p - (i + 1) as f64 / n).abs()))
        .fold(0.0, f64::max);
    // Kolmogorov's series with M. A. Stephens' correction (Journal of the Royal Statistical Society B 32, 1970).
    let t = (n.sqrt() + 0.12 + 0.11 / n.sqrt()) * distance;
    let series: f64 = (1..100)
        .map(|k: i32| {
            let sign = if k % 2 == 1 { 1.0 } else { -1.0 };
            sign * (-2.0 * f64::from(k * k) * t * t).exp()
        })
        .sum();
    Some((p.len(), distance, (2.0 * series).clamp(0.0, 1.0)))
}

fn markdown(sets: &[Set], targets: &[Target]) -> String {
    let mut out =
        format!("{} sets\n\n| target | wanted | found | 95 % bound | |\n|---|---|---|---|---|\n", sets.len());
    for t in targets {
        let sign = if t.wanted.1 { "at least" } else { "at most" };
        let bound = if t.wanted.1 { String::new() } else { format!("{:.1} %", 100.0 * t.upper()) };
        let met = match (t.of, t.met()) {
            (0, _) => "not tried",
            (_, true) => "",
            (_, false) => "**missed**",
        };
        let _ = writeln!(
            out,
            "| {} | {sign} {:.0} % | {} of {} ({:.1} %) | {bound} | {met} |",
            t.name,
            100.0 * t.wanted.0,
            t.count,
            t.of,
            100.0 * t.share()
        );
    }
    if let Some((n, distance, p)) = uniformity(sets) {
        let _ = writeln!(
            out,
            "\nNull p-values ({n} sets): Kolmogorov distance {distance:.3} from uniform, p = {p:.3}"
        );
    }
    let mut seconds: Vec<f64> = sets
        .iter()
        .filter(|s| s.plan.campaign.rows == 2000 && s.plan.kind != Kind::Power && s.plan.kind != Kind::Phase)
        .map(|s| s.found.seconds)
        .collect();
    seconds.sort_by(f64::total_cmp);
    if let Some(median) = seconds.get(seconds.len() / 2) {
        let _ = writeln!(out, "Reading and diagnosing 2000 rows, several at a time: median {median:.2} s");
    }
    out.push_str("\n| effect | sets | right | R^2 of its form against the textbook's, least to largest |\n|---|---|---|---|\n");
    for id in KNOWN {
        let own: Vec<&Set> =
            sets.iter().filter(|s| s.plan.kind == Kind::Single && s.id() == id && s.findable()).collect();
        if own.is_empty() {
            continue;
        }
        let right = own.iter().filter(|s| s.class_found() && s.said().accepted.len() == 1).count();
        let mut r2: Vec<f64> = own.iter().filter_map(|s| s.derived.r_squared.first().copied()).collect();
        r2.sort_by(f64::total_cmp);
        let note = if r2[0] > 0.995 { " (above 0.995: linear at this size)" } else { "" };
        let _ = writeln!(
            out,
            "| {id} | {} | {right} | {:.4} to {:.4}{note} |",
            own.len(),
            r2[0],
            r2[r2.len() - 1]
        );
    }
    out.push_str("\nNot right:\n\n");
    for s in sets {
        let fine = match s.plan.kind {
            Kind::Null => !s.detected(),
            Kind::Single => {
                !s.findable()
                    || (s.class_found() && s.said().accepted.len() == 1 && s.said().unexplained.is_empty())
            }
            Kind::Outside => !s.findable() || s.said().verdict == "unknown",
            Kind::Pair => s.said().accepted.len() == 2 || !s.findable(),
            Kind::Confounded => {
                s.found.follow_up.as_ref().is_some_and(|f| f.accepted == [s.id()]) || !s.findable()
            }
            Kind::Power | Kind::Phase if s.plan.hidden.is_empty() => !s.detected(),
            Kind::Power | Kind::Phase => s.said().accepted == [s.id()],
            // Those are scored by themselves.
            Kind::Formula | Kind::FormulaPower => true,
        };
        if !fine {
            let hidden: Vec<String> =
                s.plan.hidden.iter().map(|h| format!("{} {}", h.id, h.strength)).collect();
            let _ = writeln!(
                out,
                "- {} ({} rows, jitter {}): {} -> {} {:?} set {:?} left {:?}{}",
                s.plan.set,
                s.plan.campaign.rows,
                s.plan.campaign.jitter,
                if hidden.is_empty() { "nothing".to_owned() } else { hidden.join(" + ") },
                s.said().verdict,
                s.said().accepted,
                s.said().indistinguishable,
                s.said().unexplained,
                s.found.follow_up.as_ref().map_or_else(String::new, |f| format!(
                    ", then {} {:?} set {:?}",
                    f.verdict, f.accepted, f.indistinguishable
                ))
            );
        }
    }
    out
}
