//! Prescriptions: what fits is read, what does not is refused with its place.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use std::path::Path;

use retina_optics::paraxial::Paraxial;
use retina_optics::{
    Clipping, GlassCatalogue, Launcher, OpticalSystem, Tracer, parse_prescription, parse_zmx, read_system,
    shipped_design, shipped_designs,
};

const SINGLET: &str = r#"
schema = "retina.optics/1"
name = "singlet"
[beam]
entrance_pupil_mm = 10.0
[[wavelength]]
nm = 550.0
[[field]]
y_tan = 0.1
[[surface]]
stop = true
radius_mm = 50.0
thickness_mm = 5.0
glass = "N-BK7"
[[surface]]
radius_mm = -50.0
thickness_mm = 46.0
[[surface]]
"#;

fn toml(text: &str) -> Result<OpticalSystem, retina_files::InputError> {
    parse_prescription(Path::new("singlet.toml"), text)
}

#[test]
fn shipped_designs_are_read_and_named_as_their_files() {
    for name in shipped_designs() {
        assert_eq!(shipped_design(name).unwrap().unwrap().name, name);
    }
}

#[test]
fn what_does_not_fit_is_refused_with_its_place() {
    toml(SINGLET).unwrap();
    let cases = [
        (
            "\"N-BK7\"",
            "\"N-BK77\"",
            "singlet.toml, [[surface]] entry 1: glass `N-BK77` is in no catalogue",
            "`N-BK7`",
        ),
        ("thickness_mm = 46.0", "thickness_mm = -1.0", "surface 2: a negative gap", "order in which light"),
        ("stop = true\n", "", "singlet.toml, surface: the system has no stop", "limits the beam"),
        ("radius_mm = 50.0", "radius_mm = 0.0", "a radius must be finite and not 0", "plane"),
        ("nm = 550.0", "nm = 5500.0", "surface 1: glass N-BK7 has no index at 5.5 um", ""),
        (
            "radius_mm = -50.0",
            "raduis_mm = -50.0",
            "line 16, column 1: unknown field `raduis_mm`",
            "`radius_mm`",
        ),
        ("y_tan = 0.1", "y_mm = 0.1", "field 1: the field does not go with the object", "tangents"),
        ("entrance_pupil_mm = 10.0", "", "the beam's size must be given once", ""),
        (
            "retina.optics/1",
            "retina.optics/2",
            "key `schema`: is not a prescription (found `retina.optics/2`",
            "",
        ),
        ("glass = \"N-BK7\"", "part = \"AC508-150-A\"", "a stock lens brings its own radii", ""),
        ("glass = \"N-BK7\"", "index = 0.5", "no medium has this index", ""),
        ("entrance_pupil_mm = 10.0", "f_number = nan", "beam: the beam has no extent", ""),
    ];
    for (from, to, words, help) in cases {
        assert!(SINGLET.contains(from), "{from}");
        let error = toml(&SINGLET.replace(from, to)).unwrap_err();
        assert!(error.to_string().contains(words), "{to}: {error}");
        assert!(error.help.clone().unwrap_or_default().contains(help), "{to}: {:?}", error.help);
    }
    let error = read_system(Path::new("cook-triplet"), &[]).unwrap_err();
    assert!(error.help.unwrap().contains("cooke-triplet"));
}

/// The Cooke triplet as Zemax writes it; glasses as in the shipped TOML.
const COOKE: &str = "VERS 140124 258 36214\nMODE SEQ\nNAME Cooke\nUNIT MM X W X CM MR CPMM\nENPD 1.0E+1\nENVD 2.0E+1 1 0\n\
GFAC 0 0\nGCAT SCHOTT\nRAIM 0 0 1 1 0 0 0 0 0\nFTYP 0 0 3 3 0 0 0\nXFLN 0 0 0\nYFLN 0 14 20\nFWGN 1 1 1\n\
VDXN 0 0 0\nVDYN 0 0 0\nVCXN 0 0 0\nVCYN 0 0 0\nVANN 0 0 0\nWAVM 1 4.8E-1 1\nWAVM 2 5.5E-1 1\nWAVM 3 6.5E-1 1\nWAVM 4 5.5E-1 1\n\
PWAV 2\nSURF 0\n  TYPE STANDARD\n  CURV 0.0 0 0 0 0\n  DISZ INFINITY\n\
SURF 1\n  TYPE STANDARD\n  CURV 0.045426484276303865 0 0 0 0 \"\"\n  DISZ 3.25896\n  GLAS N-SK16 0 0 1.5 40.0\n  DIAM 9.5 0 0 0 1 \"\"\n\
SURF 2\n  CURV -0.0022948388798212154 0\n  DISZ 6.00755\n\
SURF 3\n  CURV -0.04501811528959253 0\n  DISZ 0.99997\n  GLAS F2 0 0 1.62 36.37\n\
SURF 4\n  STOP\n  CURV 0.04928069891858434 0\n  DISZ 4.75041\n\
SURF 5\n  CURV 0.012549633801685667 0\n  DISZ 2.95208\n  GLAS N-SK16 0 0 1.62 60.32\n\
SURF 6\n  CURV -0.05436162330330578 0\n  DISZ 42.20778\n\
SURF 7\n  CURV 0.0 0\n  DISZ 0\n";

fn zmx(text: &str) -> Result<OpticalSystem, retina_files::InputError> {
    parse_zmx(Path::new("cooke.zmx"), text, &GlassCatalogue::embedded())
}

#[test]
fn a_zmx_file_is_the_system_that_the_toml_is() {
    let (a, b) = (zmx(COOKE).unwrap(), shipped_design("cooke-triplet").unwrap().unwrap());
    assert_eq!((a.stop, a.primary, a.wavelengths.len()), (b.stop, b.primary, 3));
    let efl = |s: &OpticalSystem| Paraxial::primary(s).unwrap().first_order().efl_mm.unwrap();
    assert!((efl(&a) - efl(&b)).abs() < 1e-9);
    for field in 0..3 {
        let hit = |s: &OpticalSystem| {
            let ray = Launcher::new(s).unwrap().ray(s.fields[field].at, [0.4, -0.7]).unwrap();
            Tracer::new(s, 650.0, Clipping::Off).unwrap().trace_to_image(&ray).unwrap().local_mm
        };
        assert!((hit(&a) - hit(&b)).length() < 1e-9, "field {field}");
    }
}

/// The format's DIAM: semi-diameter, then how it is solved for (1: fixed by the user). A fixed one limits a
/// surface that bends light, an automatic one is the extent of the beam, and a CLAP comes before both.
#[test]
fn a_fixed_diameter_of_a_zmx_file_is_an_aperture() {
    let outer = |from: &str, to: &str| {
        assert!(COOKE.contains(from), "{from}");
        let system = zmx(&COOKE.replacen(from, to, 1)).unwrap();
        [0, 5, 6].map(|i| system.surfaces[i].aperture.outer_mm)
    };
    let none = f64::INFINITY;
    assert_eq!(outer("DIAM 9.5 0", "DIAM 9.5 0"), [none; 3]);
    assert_eq!(outer("DIAM 9.5 0", "DIAM 9.5 1"), [9.5, none, none]);
    assert_eq!(outer("DIAM 9.5 0", "CLAP 0 9 0\n  DIAM 9.5 1"), [9.0, none, none]);
    // The image bends no light.
    assert_eq!(outer("DISZ 0\n", "DISZ 0\n  DIAM 4.0 1 0 0 1 \"\"\n"), [none; 3]);
    assert_eq!(outer("DISZ 42.20778\n", "DISZ 42.20778\n  DIAM 7.0 2 1\n"), [none, 7.0, none]);
    let error = zmx(&COOKE.replacen("DIAM 9.5 0", "DIAM 9.5 8", 1)).unwrap_err().to_string();
    assert!(error.contains("unknown kind of semi-diameter"), "{error}");
}

#[test]
fn zmx_in_utf16_is_read_too() {
    let folder = std::env::temp_dir().join(format!("retina-zmx-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("cooke.zmx");
    let bytes: Vec<u8> =
        std::iter::once(0xfeffu16).chain(COOKE.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    std::fs::write(&path, bytes).unwrap();
    let read = read_system(&path, &[]);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(read.unwrap(), zmx(COOKE).unwrap());
}

#[test]
fn zmx_that_is_not_understood_is_refused_by_name_and_line() {
    let cases = [
        ("MODE SEQ", "MODE NSC", "line 2: MODE is not sequential"),
        (
            "  TYPE STANDARD\n  CURV 0.045",
            "  TYPE NONSEQCO\n  CURV 0.045",
            "line 28: a non-sequential part (found NONSEQCO)",
        ),
        (
            "  TYPE STANDARD\n  CURV 0.045",
            "  TYPE TOROIDAL\n  CURV 0.045",
            "a surface type that is not understood (found TOROIDAL",
        ),
        ("GLAS F2", "GLAS F22", "glass `F22` is in no catalogue"),
        ("GLAS F2", "GLAS MIRROR", "line 40: mirrors and model glasses are not supported"),
        ("  STOP\n", "", "the system has no stop"),
        ("VCYN 0 0 0", "VCYN 0 0.1 0", "line 17: VCYN gives vignetting factors"),
        ("GFAC 0 0", "XYZZ 0 0", "line 7: XYZZ is not understood"),
        ("DISZ 6.00755", "DISZ -6.00755", "surface 2: a negative gap"),
        ("FTYP 0", "FTYP 3", "fields of this type"),
        (
            "FTYP 0 0 3 3",
            "FTYP 0 0 1e308 3",
            "FTYP states a number of fields or wavelengths that no system has",
        ),
        ("FTYP 0 0 3 3", "FTYP 0 0 3 1e20", "(found FTYP 0 0 3 1e20 0 0 0, expected 0 to 100)"),
        ("ENVD 2.0E+1", "ENVD 3.0E+1", "ENVD is not 20 degC"),
        ("  DISZ 0.99997", "  PARM 1 0.5\n  DISZ 0.99997", "a STANDARD surface has no parameters"),
    ];
    for (from, to, words) in cases {
        assert!(COOKE.contains(from), "{from}");
        let error = zmx(&COOKE.replacen(from, to, 1)).unwrap_err();
        assert!(error.to_string().contains(words), "{to}: {error}");
    }
}
