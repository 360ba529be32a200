use std::path::{Path, PathBuf};

use super::candidate::Library;
use super::exact::{Quadratic, best_common_focus};
use super::third_order::{Ranking, group_sums};
use super::*;
use crate::analysis::{SpotOptions, spots};
use crate::{Clipping, parse_prescription};

/// A design of the project's reference set, which two other programs traced: lenses from the camera on,
/// gaps (mm), s_cam / f_c, and for the wide and the narrow camera pupil to first vertex, collimator to
/// relay, paraxial screen, defocus (mm) and RMS on the sensor (um) at the three fields.
struct Reference {
    collimator: [(&'static str, bool); 3],
    collimator_gaps_mm: [f64; 2],
    relay: [(&'static str, bool); 2],
    pupil_factor: f64,
    configurations: [([f64; 4], [f64; 3]); 2],
}

const REFERENCES: [Reference; 3] = [
    Reference {
        collimator: [("AC508-200-A", true), ("AC508-500-A", false), ("AC508-200-A", false)],
        collimator_gaps_mm: [3.0, 5.117357150509463],
        relay: [("AC508-180-A", true), ("AC508-150-A", false)],
        pupil_factor: 1.0,
        configurations: [
            (
                [73.85674596197505, 260.33812870785374, 131.51753909302667, -0.9667107246702176],
                [18.133, 6.011, 19.921],
            ),
            (
                [73.85674596197505, 202.85513659940204, 191.1511780924133, -1.6457092192434364],
                [12.078, 12.257, 15.037],
            ),
        ],
    },
    Reference {
        collimator: [("AC508-250-A", true), ("AC508-750-A", false), ("AC508-150-A", false)],
        collimator_gaps_mm: [8.0, 1.6801669819842857],
        relay: [("AC508-180-A", true), ("AC508-150-A", false)],
        pupil_factor: 1.3,
        configurations: [
            (
                [97.04700742857955, 259.53612593464305, 131.51753909302667, -0.7346703478771548],
                [13.82, 3.423, 14.556],
            ),
            (
                [97.04700742857955, 202.05313382619136, 191.1511780924133, -1.7221686859929242],
                [13.814, 12.728, 14.271],
            ),
        ],
    },
    Reference {
        collimator: [("AC508-250-A", true), ("AC508-500-A", false), ("AC508-150-A", false)],
        collimator_gaps_mm: [15.0, 10.784804869359249],
        relay: [("AC508-150-A", true), ("AC508-180-A", false)],
        pupil_factor: 1.5,
        configurations: [
            (
                [103.32934205888452, 251.36630385666024, 132.10033603478337, -0.7225555998462037],
                [10.53, 8.083, 12.352],
            ),
            (
                [103.32934205888452, 193.88331174820854, 191.73397503417, -1.185321208849834],
                [13.522, 5.511, 13.824],
            ),
        ],
    },
];

fn elements(lenses: &[(&str, bool)]) -> Vec<Element> {
    lenses.iter().map(|&(part, reversed)| Element { part: part.to_owned(), reversed }).collect()
}

impl Reference {
    fn design(&self) -> FacilityDesign {
        FacilityDesign {
            collimator: GroupDesign {
                elements: elements(&self.collimator),
                gaps_mm: self.collimator_gaps_mm.to_vec(),
            },
            relay: GroupDesign { elements: elements(&self.relay), gaps_mm: vec![2.175024303956519] },
        }
    }
}

/// Distances agree with the other programs' to 1 um (their focal lengths are at 544 nm, as here), spots to 2 %.
#[test]
fn reference_designs_stand_and_image_as_traced_elsewhere() {
    for reference in &REFERENCES {
        let request = SearchRequest::paper(reference.pupil_factor);
        for (i, (distances, rms_um)) in reference.configurations.iter().enumerate() {
            let focus = ScreenFocus::Defocus(distances[3]);
            let (results, _) = evaluate(&reference.design(), &request, focus).unwrap();
            let got = &results[i];
            assert!((got.m - [-1.388478, -0.694239][i]).abs() < 1e-6, "{}", got.m);
            let screen = distances[2] + distances[3];
            let pairs = [
                (got.pupil_to_first_vertex_mm, distances[0]),
                (got.collimator_to_relay_mm, distances[1]),
                (got.relay_to_screen_mm, screen),
            ];
            for (got, expected) in pairs {
                assert!((got - expected).abs() < 1e-3, "s_cam {}: {got} {expected}", reference.pupil_factor);
            }
            for (field, expected) in got.fields.iter().zip(rms_um) {
                assert!((field.rms_um / expected - 1.0).abs() < 0.02, "{field:?}, expected {expected}");
            }
            // The best common focus is no worse than the reference's, which minimises another mean.
            let (best, _) = evaluate(&reference.design(), &request, ScreenFocus::Best).unwrap();
            let worst = |fields: &[FieldResult]| fields.iter().map(|f| f.rms_um).fold(0.0, f64::max);
            assert!(worst(&best[i].fields) <= worst(&got.fields) * 1.0001, "{:?}", best[i]);
        }
    }
}

/// Two parabolas s^2 and (s - 2)^2 + 1 meet at s = 5/4; of s^2 and s^2 / 4 - 1 the first leads at its vertex.
#[test]
fn best_common_focus_is_where_the_worst_is_least() {
    let a = Quadratic { constant: 0.0, half_linear: 0.0, square: 1.0 };
    let b = Quadratic { constant: 5.0, half_linear: -2.0, square: 1.0 };
    let (s, value) = best_common_focus(&[a, b]);
    assert!((s - 1.25).abs() < 1e-12 && (value - 1.5625).abs() < 1e-12, "{s} {value}");
    let flat = Quadratic { constant: -1.0, half_linear: 0.0, square: 0.25 };
    let (s, value) = best_common_focus(&[flat, a]);
    assert!(s == 0.0 && value == 0.0, "{s} {value}");
}

/// The sums of the two groups against the whole system's, by the analysis that textbook cases prove,
/// at the paraxial rays of the same pupil and field.
#[test]
fn third_order_sums_of_groups_add_to_the_systems() {
    let reference = &REFERENCES[1];
    let request = SearchRequest::paper(reference.pupil_factor);
    let source = Path::new("test");
    let (library, groups) = Library::of_design(&reference.design(), &request, source).unwrap();
    let figures = groups.map(|group| library.figures(&group));
    let (_, systems) = evaluate(&reference.design(), &request, ScreenFocus::Defocus(0.0)).unwrap();
    for (configuration, system) in request.configurations.iter().zip(&systems) {
        let ranking = Ranking::new(&request, configuration);
        let sums = [0, 1]
            .map(|g| group_sums(&library, &groups[g], figures[g].front_principal_mm, &ranking.entries[g]).0);
        let sums = sums[0].plus(&sums[1]);
        let whole = crate::analysis::seidel_sums(system).unwrap().sum;
        let expected = [whole.spherical_mm, whole.coma_mm, whole.astigmatism_mm, whole.petzval_mm];
        for (got, expected) in sums.seidel.iter().zip(expected) {
            assert!((got - expected).abs() < 1e-5 * expected.abs(), "{sums:?} {expected:?}");
        }
    }
}

#[derive(Default)]
struct Notes(Vec<SearchProgress>);

impl SearchObserver for Notes {
    fn progress(&mut self, progress: SearchProgress) {
        self.0.push(progress);
    }
    fn note(&mut self, _: &str) {}
}

fn small() -> SearchRequest {
    SearchRequest {
        part_prefixes: ["AC508-150-A", "AC508-180-A", "AC508-250-A", "AC508-750-A"]
            .map(str::to_owned)
            .to_vec(),
        exact_candidates: 400,
        leaders: 2,
        ..SearchRequest::paper(1.3)
    }
}

/// With the reference's own four lenses on the shelf the search finds the reference or better, and all it
/// reports keeps the focal lengths and limits.
#[test]
fn a_small_search_finds_the_reference() {
    let report = search(&small(), Path::new("test"), None, &mut Notes::default()).unwrap();
    let best = &report.designs[0];
    assert!(best.worst_rms_um <= 14.6, "{best:?}");
    for design in &report.designs {
        assert!((design.collimator_efl_mm - 86.8).abs() < 1e-9 && (design.relay_efl_mm - 82.8).abs() < 1e-9);
        assert!(
            design.lenses.iter().filter_map(|lens| lens.gap_after_mm).all(|gap| (0.5..=40.0).contains(&gap))
        );
        assert!(design.configurations.iter().flat_map(|c| &c.fields).all(|f| f.vignetted_fraction <= 0.01));
    }
    let front = report.pareto();
    assert!(front.windows(2).all(|w| report.designs[w[0]].length_mm > report.designs[w[1]].length_mm));
}

/// Keeps every state that is written, as a kill at that moment would leave it.
struct Keeper {
    file: PathBuf,
    states: Vec<Vec<u8>>,
}

impl SearchObserver for Keeper {
    fn progress(&mut self, _: SearchProgress) {
        let state = std::fs::read(&self.file).unwrap();
        if self.states.last() != Some(&state) {
            self.states.push(state);
        }
    }
    fn note(&mut self, _: &str) {}
}

/// From every state that a killed search could leave, the first before anything was ranked, the resumed
/// search gives the same bytes.
#[test]
fn a_killed_search_resumes_to_the_same_bytes_and_refuses_anothers_state() {
    let folder = std::env::temp_dir().join(format!("retina-search-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("state.json");
    let mut request = small();
    // Few enough that swaps find new lens sets, more than one chunk of refits, and kicks.
    request.exact_candidates = 600;
    request.leaders = 3;
    let mut keeper = Keeper { file: file.clone(), states: Vec::new() };
    let text = |report: &SearchReport| serde_json::to_string(report).unwrap();
    let whole = text(&search(&request, Path::new("test"), Some(&file), &mut keeper).unwrap());
    assert_eq!(whole, text(&search(&request, Path::new("test"), None, &mut Notes::default()).unwrap()));
    assert!(keeper.states.len() > 6, "{}", keeper.states.len());
    for (i, state) in keeper.states.iter().enumerate() {
        std::fs::write(&file, state).unwrap();
        let again = search(&request, Path::new("test"), Some(&file), &mut Notes::default()).unwrap();
        assert_eq!(text(&again), whole, "from state {i}");
    }
    let mut notes = Notes::default();
    search(&request, Path::new("test"), Some(&file), &mut notes).unwrap();
    assert!(notes.0.iter().all(|progress| progress.phase == Phase::Rank), "all was done: {:?}", notes.0);
    request.seed += 1;
    let error = search(&request, Path::new("test"), Some(&file), &mut notes).unwrap_err();
    assert!(error.to_string().contains("belongs to another search"), "{error}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A written prescription is the system that was searched: the same spots by the ray trace of a file.
#[test]
fn a_design_is_read_back_from_its_prescriptions() {
    let mut request = small();
    request.exact_candidates = 50;
    request.configurations[0].name = "wide \"a\"\n".into();
    let report = search(&request, Path::new("test"), None, &mut Notes::default()).unwrap();
    let design = &report.designs[0];
    let files = design.prescriptions(&request);
    assert_eq!(files.len(), 2);
    for ((result, asked), (name, text)) in
        design.configurations.iter().zip(&request.configurations).zip(&files)
    {
        assert_eq!(name, &asked.name);
        let system = parse_prescription(Path::new("out.toml"), text).unwrap();
        let options = SpotOptions { rings: 12, arms: 24, clipping: Clipping::Off };
        let spots = spots(&system, &options).unwrap();
        let scale = asked.camera_focal_mm / asked.facility_focal_mm(request.collimator_focal_mm);
        for (field, spot) in result.fields.iter().zip(&spots.fields) {
            assert!((spot.rms_um * scale - field.rms_um).abs() < 1e-9, "{field:?} {spot:?}");
        }
    }
}

/// The bench decides the length whatever the lenses are: eqs. 4-6 give s_oc = s_or + s_ri + f_c, with
/// f_r (1 + |M|) + f_r (1 + 1 / |M|) + f_c: 427.0 mm for the wide and 429.2 mm for the narrow camera.
#[test]
fn where_nothing_fits_the_limit_is_named_and_the_nearest_miss_is_shown() {
    let mut request = small();
    request.exact_candidates = 20;
    request.bench.total_length_mm = 300.0;
    let report = search(&request, Path::new("test"), None, &mut Notes::default()).unwrap();
    assert!(report.designs.is_empty());
    let by_limit = |limit| report.removed.iter().find(|entry| entry.limit == limit).map(|e| e.candidates);
    assert_eq!((by_limit(Limit::TotalLength), by_limit(Limit::Vignetting)), (Some(20), None));
    let miss = report.nearest_miss.unwrap();
    let f_r = request.relay_focal_mm;
    let length = |m: f64| f_r * (1.0 + m) + f_r * (1.0 + 1.0 / m) + request.collimator_focal_mm;
    let longest = request.configurations.iter().map(|c| length(c.magnification.abs())).fold(0.0, f64::max);
    assert_eq!(miss.exceeds.len(), 1);
    assert!(miss.exceeds[0].limit == Limit::TotalLength);
    assert!((miss.exceeds[0].by - (longest - 300.0)).abs() < 1e-9, "{:?} {longest}", miss.exceeds);
    assert!(miss.design.worst_rms_um < 60.0, "{:?}", miss.design);
}

#[test]
fn searches_that_cannot_be_are_refused() {
    let refusal = |change: fn(&mut SearchRequest)| {
        let mut request = small();
        change(&mut request);
        search(&request, Path::new("test"), None, &mut Notes::default()).unwrap_err().to_string()
    };
    assert!(refusal(|r| r.part_prefixes = vec!["NONE".into()]).contains("no stock lens is left"));
    assert!(refusal(|r| r.relay_lenses = 7).contains("relay lenses"));
    assert!(refusal(|r| r.relay_focal_mm = 20.0).contains("no pair of groups reaches"));
    assert!(refusal(|r| r.configurations[0].magnification = 1.0).contains("magnification"));
}
