//! Every reader of `fuzz/` over its corpus and over seeded changes of it: none may panic, take longer than
//! [`LONGEST`], or hold more than [`MOST_MEMORY_KB`].
//!
//! Each reader runs in a process of its own, so that an abort, a stack that overflows and a reader that does not
//! return are told with the input that did it. More inputs: `RETINA_MUTATIONS=100000 RETINA_SEED=7 cargo nextest run
//! --release -p retina-tests every_reader`; inputs that fail are kept in the folder `RETINA_FINDINGS`.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

#[path = "../../fuzz/src/lib.rs"]
pub mod readers;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use readers::{READERS, Reader};

/// Longest that one input may take; most take less than a millisecond.
const LONGEST: Duration = Duration::from_secs(10);
/// Most address space of a process, kilobytes: a reader's own share is far below, the rest are threads' stacks.
const MOST_MEMORY_KB: usize = 4 << 20;
/// Changed inputs of each reader.
const MUTATIONS: usize = 300;

fn corpus(name: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(name);
    let mut paths: Vec<PathBuf> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let name_of = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    paths.iter().map(|path| (name_of(path), fs::read(path).unwrap())).collect()
}

fn number_of(variable: &str, otherwise: usize) -> usize {
    std::env::var(variable).ok().map_or(otherwise, |text| text.parse().unwrap())
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count.max(1) as u64) as usize
    }
}

/// Numbers that readers forget.
const NUMBERS: [&str; 22] = [
    "NaN",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e999",
    "1e-320",
    "-1",
    "0",
    "-0.0",
    "1",
    "2",
    "65535",
    "65536",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "1e7",
    "1e20",
    "0.5",
];
const WHOLE: [i64; 12] =
    [0, 1, -1, 2, 127, 255, 32_767, 65_535, i32::MAX as i64, i32::MIN as i64, i64::MAX, i64::MIN];
const REAL: [f64; 10] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e30, -1e30, 1e-310, 0.0, -1.0, 1e12];

/// Where the numbers of a text stand.
fn number_spans(bytes: &[u8]) -> Vec<[usize; 2]> {
    let is_part = |byte: u8| byte.is_ascii_digit() || b"+-.eE".contains(&byte);
    let mut spans = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let end = at + bytes[at..].iter().take_while(|&&byte| is_part(byte)).count();
        if bytes[at..end].iter().any(u8::is_ascii_digit) {
            spans.push([at, end]);
        }
        at = end + 1;
    }
    spans
}

/// One change of an input.
fn change(bytes: &mut Vec<u8>, others: &[(String, Vec<u8>)], random: &mut Random) {
    if bytes.is_empty() {
        bytes.extend(&others[random.below(others.len())].1);
        return;
    }
    let length = bytes.len();
    let at = random.below(length);
    let stretch = at..(at + 1 + random.below(64)).min(length);
    match random.below(12) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.next() as u8,
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(stretch)),
        4 => {
            let copy = bytes[stretch].to_vec();
            let to = random.below(length);
            bytes.splice(to..to, copy);
        }
        5 => {
            let other = &others[random.below(others.len())].1;
            let from = random.below(other.len());
            bytes.truncate(at);
            bytes.extend(&other[from..]);
        }
        6..=8 => {
            let spans = number_spans(bytes);
            let Some(&[from, to]) = spans.get(random.below(spans.len())) else { return };
            bytes.splice(from..to, NUMBERS[random.below(NUMBERS.len())].bytes());
        }
        9 => {
            // A line twice, or moved.
            let lines: Vec<Vec<u8>> =
                bytes.split_inclusive(|&byte| byte == b'\n').map(<[u8]>::to_vec).collect();
            let line = lines[random.below(lines.len())].clone();
            let to: usize = lines[..random.below(lines.len())].iter().map(Vec::len).sum();
            bytes.splice(to..to, line);
        }
        kind => {
            let width = [1, 2, 4, 8][random.below(4)];
            let word = if kind == 10 {
                WHOLE[random.below(WHOLE.len())].to_le_bytes()
            } else {
                REAL[random.below(REAL.len())].to_le_bytes()
            };
            let word = if kind == 11 { word.to_vec() } else { word[..width].to_vec() };
            // Words of a binary file mostly stand at multiples of their size.
            let at = at - at % word.len();
            let big_endian = random.below(2) == 1;
            for (k, slot) in bytes[at..].iter_mut().take(word.len()).enumerate() {
                *slot = word[if big_endian { word.len() - 1 - k } else { k }];
            }
        }
    }
}

/// What became of an input, if it was wrong.
fn fault(reader: Reader, bytes: &[u8]) -> Option<String> {
    let start = Instant::now();
    let ended = catch_unwind(AssertUnwindSafe(|| reader(bytes)));
    let took = start.elapsed();
    match ended {
        Err(panic) => {
            let said = panic.downcast_ref::<String>().cloned();
            Some(said.or(panic.downcast_ref::<&str>().map(|s| (*s).to_owned())).unwrap_or_default())
        }
        Ok(()) => (took > LONGEST).then(|| format!("took {:.1} s", took.as_secs_f64())),
    }
}

/// The part of the test that runs in a process of its own: one reader, named by the environment.
#[test]
fn one_reader() {
    let Ok(name) = std::env::var("RETINA_READER") else { return };
    let kept = PathBuf::from(std::env::var_os("RETINA_FINDINGS").unwrap());
    let reader = READERS.iter().find(|(known, _)| *known == name).unwrap().1;
    let files = corpus(&name);
    let mut faults = 0;
    let mut run = |label: String, bytes: &[u8]| {
        // Whatever ends the process, this was the input.
        let input = kept.join(format!("{name}-{label}"));
        fs::write(&input, bytes).unwrap();
        match fault(reader, bytes) {
            None => fs::remove_file(&input).unwrap(),
            Some(fault) => {
                faults += 1;
                println!("{name} {label}: {fault}");
            }
        }
    };
    files.iter().for_each(|(file, bytes)| run(file.clone(), bytes));
    run("nothing".into(), b"");
    let seed = number_of("RETINA_SEED", 1) as u64;
    for number in 0..number_of("RETINA_MUTATIONS", MUTATIONS) {
        let mut random = Random(seed << 40 ^ number as u64);
        let mut bytes = files[random.below(files.len())].1.clone();
        (0..=random.below(4)).for_each(|_| change(&mut bytes, &files, &mut random));
        run(format!("{seed}-{number}"), &bytes);
    }
    readers::clean_up();
    assert_eq!(faults, 0, "of {name}; see above");
}

#[test]
fn every_reader_refuses_or_reads_whatever_it_is_fed() {
    let own = tempfile::tempdir().unwrap();
    let kept = std::env::var_os("RETINA_FINDINGS").map_or_else(|| own.path().to_path_buf(), PathBuf::from);
    fs::create_dir_all(&kept).unwrap();
    // A tenth of a second an input would be very slow.
    let patience = Duration::from_secs(60 + number_of("RETINA_MUTATIONS", MUTATIONS) as u64 / 10);
    let mut wrong = Vec::new();
    for (name, _) in READERS {
        let start = Instant::now();
        let mut command = if cfg!(unix) {
            let mut command = Command::new("sh");
            command.args(["-c", &format!("ulimit -v {MOST_MEMORY_KB}; exec \"$0\" \"$@\"")]);
            command.arg(std::env::current_exe().unwrap());
            command
        } else {
            Command::new(std::env::current_exe().unwrap())
        };
        command.args(["--exact", "one_reader", "--nocapture"]);
        command.env("RETINA_READER", name).env("RETINA_FINDINGS", &kept).env("RUST_BACKTRACE", "0");
        // Threads hold address space each.
        command.env("RAYON_NUM_THREADS", "2");
        let log = fs::File::create(kept.join(format!("{name}.log"))).unwrap();
        let mut child = command.stdout(log.try_clone().unwrap()).stderr(log).spawn().unwrap();
        let status = loop {
            match child.try_wait().unwrap() {
                Some(status) => break Some(status),
                None if start.elapsed() > patience => {
                    child.kill().unwrap();
                    child.wait().unwrap();
                    break None;
                }
                None => std::thread::sleep(Duration::from_millis(10)),
            }
        };
        println!("{name}: {:.2} s", start.elapsed().as_secs_f64());
        if !status.is_some_and(|status| status.success()) {
            let text =
                String::from_utf8_lossy(&fs::read(kept.join(format!("{name}.log"))).unwrap()).into_owned();
            let last: Vec<&str> = text.lines().rev().take(12).collect();
            wrong.push(format!(
                "{name}: {}\n{}",
                status.map_or("did not end".to_owned(), |status| status.to_string()),
                last.into_iter().rev().collect::<Vec<_>>().join("\n")
            ));
        }
    }
    assert!(wrong.is_empty(), "inputs are kept in {}:\n{}", kept.display(), wrong.join("\n"));
}

/// The valid inputs are read, not refused: a corpus of refusals would test little. And the test can fail.
#[test]
fn the_corpus_is_valid_and_a_fault_is_seen() {
    for (name, _) in READERS {
        assert!(!corpus(name).is_empty(), "{name}");
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus");
    let at = |file: &str| folder.join(file);
    assert!(retina_geometry::Setup::read(&at("setup/all.toml")).is_ok());
    assert!(retina_model::load_body(&at("glb/sphere.glb")).is_ok());
    assert!(retina_model::load_body(&at("gltf/tetrahedron.gltf")).is_ok());
    assert!(retina_batch::read_exr(&at("exr/rendered.exr")).is_ok());
    assert!(retina_sky::ephemeris::Ephemeris::read(&[at("spk/circles.bsp")]).is_ok());
    assert!(retina_optics::read_system(&at("zmx/cooke.zmx"), &[]).is_ok());
    assert_eq!(retina_optics::glass::read_agf(&at("agf/bk7.agf")).unwrap().len(), 2);
    for file in ["fits/int16.fits", "fits/float.fits", "raster/grey16.png", "raster/grey16.tiff"] {
        assert!(retina_image::CameraImage::read(&at(file), Default::default()).is_ok(), "{file}");
    }
    let photograph = retina_image::Photograph::read(&at("raster/exif.jpg"), Default::default()).unwrap();
    assert_eq!((photograph.exif.focal_35mm_mm, photograph.exif.orientation), (Some(75.0), Some(6)));
    assert!(retina_corto::Settings::read(&at("corto_scene/eros.json"), &mut Vec::new()).is_ok());
    assert!(retina_corto::decode_pose(&fs::read(at("datagram/pose.bin")).unwrap()).is_ok());
    let said = fault(|bytes| assert!(bytes.is_empty(), "not empty"), b"x");
    assert_eq!(said.as_deref(), Some("not empty"));
}
