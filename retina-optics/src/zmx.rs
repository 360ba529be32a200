//! Sequential prescriptions in Zemax's `.zmx` text format.
//!
//! What changes the result is understood or refused by name; what only concerns the editor,
//! drawings, merit functions and coatings is passed over, by name as well (`IGNORED`).

use std::path::Path;

use retina_files::InputError;

use crate::glass::{GlassCatalogue, Medium};
use crate::paraxial::efl_of_mm;
use crate::surface::{Aperture, Shape, Surface};
use crate::system::{Aiming, Beam, Field, Object, OpticalSystem, Wavelength};
use crate::text::number;

/// Most fields of a system (the program has 12, and 200 in newer editions) and most wavelengths (24).
const MOST_FIELDS: f64 = 1000.0;
const MOST_WAVES: f64 = 100.0;
/// Keywords without influence on the geometric trace as it is done here: identification, editor and
/// drawing, polarisation, coatings, scatter and physical optics, defaults for non-sequential objects,
/// tolerances, merit function, and the catalogue list (glasses are matched by name).
const IGNORED: &[&str] = &[
    "VERS", "NAME", "NOTE", "PFIL", "LANG", "GFAC", "GCAT", "PUSH", "SDMA", "OMMA", "ROPD", "PICB", "POLS",
    "GLRS", "GSTD", "NSCD", "COFN", "RSCE", "RWRE", "FIMP", "HIDE", "MIRR", "SLAB", "SCOL", "COMM", "POPS",
    "OEMA", "MEMA", "COAT", "BLNK", "SCBD", "TOL", "MOFF", "MERI", "EFFL", "UDAD",
];

#[derive(Clone)]
struct Row {
    line: usize,
    kind: String,
    curvature_per_mm: f64,
    conic: f64,
    parameters: [f64; 8],
    thickness_mm: f64,
    glass: Option<(usize, String)>,
    semi_diameter_mm: Option<f64>,
    /// The editor's user fixed the semi-diameter: it is no mere extent of the beam.
    is_fixed: bool,
    clear: Option<[f64; 2]>,
    stop: bool,
    label: String,
}

#[derive(Default)]
struct Header {
    beam: Option<Beam>,
    /// FLOA: the stop's semi-diameter gives the beam.
    beam_by_stop: bool,
    field_type: Option<u32>,
    field_count: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    field_weights: Vec<f64>,
    waves: Vec<(usize, f64, f64)>,
    wave_values: Vec<f64>,
    wave_count: usize,
    primary: usize,
    aiming: Aiming,
    unit_mm: f64,
    name: String,
}

/// Reads a sequential system; `path` names it in errors.
///
/// # Errors
/// A keyword or surface type that is not understood, by name and line; non-sequential parts; what
/// [`OpticalSystem::check`] refuses.
pub fn parse_zmx(path: &Path, text: &str, glasses: &GlassCatalogue) -> Result<OpticalSystem, InputError> {
    let mut header = Header { unit_mm: 1.0, ..Header::default() };
    let mut rows: Vec<Row> = Vec::new();
    for (i, content) in text.lines().enumerate() {
        let words: Vec<&str> = content.split_whitespace().collect();
        let Some((&key, words)) = words.split_first() else { continue };
        let line = Line { path, line: i + 1, content, key, words };
        if key == "SURF" {
            rows.push(Row {
                line: i + 1,
                kind: "STANDARD".into(),
                curvature_per_mm: 0.0,
                conic: 0.0,
                parameters: [0.0; 8],
                thickness_mm: 0.0,
                glass: None,
                semi_diameter_mm: None,
                is_fixed: false,
                clear: None,
                stop: false,
                label: String::new(),
            });
        } else if IGNORED.contains(&key) || key == "!" {
            if key == "NAME" {
                header.name = words.join(" ");
            } else if key == "COMM"
                && let Some(row) = rows.last_mut()
            {
                row.label = words.join(" ");
            }
        } else if content.starts_with(char::is_whitespace) {
            // Surface keywords are indented below their SURF line.
            let row = rows.last_mut().ok_or_else(|| line.error("stands before the first surface"))?;
            surface_line(row, &line)?;
        } else {
            header_line(&mut header, &line)?;
        }
    }
    assemble(path, header, rows, glasses)
}

struct Line<'a> {
    path: &'a Path,
    line: usize,
    content: &'a str,
    key: &'a str,
    words: &'a [&'a str],
}

impl Line<'_> {
    /// The line's key is none that is traced.
    fn refused(&self) -> InputError {
        if self.key.starts_with("NS") {
            return self.error("belongs to a non-sequential part").help("only sequential systems are traced");
        }
        self.error("is not understood").help("it may change the result: remove it if it does not")
    }

    fn error(&self, problem: &str) -> InputError {
        InputError::new(self.path, format!("{} {problem}", self.key))
            .line(self.line)
            .found(self.content.trim())
    }

    fn value(&self, n: usize) -> Result<f64, InputError> {
        let word = self.words.get(n).ok_or_else(|| self.error("has too few values"))?;
        // Zemax writes 1.0E+010 for "nothing"; INFINITY only for distances, which are read apart.
        number(self.path, self.line, word)
    }

    fn values(&self) -> Result<Vec<f64>, InputError> {
        (0..self.words.len()).map(|n| self.value(n)).collect()
    }

    /// All values given are 0, or text that says "none".
    fn is_zero(&self) -> bool {
        self.words.iter().all(|word| word.parse::<f64>().map_or(word.starts_with('"'), |v| v == 0.0))
    }

    fn refuse_unless_zero(&self, what: &str) -> Result<(), InputError> {
        if self.is_zero() { Ok(()) } else { Err(self.error(what)) }
    }
}

fn header_line(header: &mut Header, line: &Line<'_>) -> Result<(), InputError> {
    match line.key {
        "MODE" if line.words.first() == Some(&"SEQ") => {}
        "MODE" => return Err(line.error("is not sequential").expected("MODE SEQ")),
        "UNIT" => {
            header.unit_mm = match line.words.first() {
                Some(&"MM") => 1.0,
                Some(&"CM") => 10.0,
                Some(&"METER") => 1000.0,
                Some(&"IN") => 25.4,
                _ => return Err(line.error("is of an unknown unit").expected("MM, CM, METER or IN")),
            }
        }
        "ENPD" => header.beam = Some(Beam::EntrancePupil(line.value(0)?)),
        "FNUM" => {
            if line.words.len() > 1 && line.value(1)? != 0.0 {
                return Err(line.error("of the working (real-ray) kind is not supported"));
            }
            header.beam = Some(Beam::FNumber(line.value(0)?));
        }
        "OBNA" => header.beam = Some(Beam::ObjectNa(line.value(0)?)),
        "FLOA" => header.beam_by_stop = true,
        "ENVD" => {
            let reference = line.words.len() >= 2 && line.value(0)? == 20.0 && line.value(1)? == 1.0;
            if !reference {
                return Err(line.error("is not 20 degC and 1 atm, to which the catalogue's indices belong"));
            }
        }
        "GLAZ" => line.refuse_unless_zero("is not supported")?,
        "RAIM" => {
            header.aiming = if line.words.is_empty() || line.is_zero() || line.words.get(1) == Some(&"0") {
                Aiming::Paraxial
            } else {
                Aiming::Stop
            };
        }
        "FTYP" => {
            header.field_type = Some(line.value(0)? as u32);
            if line.words.get(1).is_some_and(|word| *word != "0") {
                return Err(line.error("asks for telecentric object space, which is not supported"));
            }
            if line.words.len() > 3 {
                for (at, most, count) in
                    [(2, MOST_FIELDS, &mut header.field_count), (3, MOST_WAVES, &mut header.wave_count)]
                {
                    let value = line.value(at)?;
                    if !(0.0..=most).contains(&value) {
                        return Err(line
                            .error("states a number of fields or wavelengths that no system has")
                            .expected(format!("0 to {most}")));
                    }
                    *count = value as usize;
                }
            }
        }
        "XFLN" | "XFLD" => header.x = line.values()?,
        "YFLN" | "YFLD" => header.y = line.values()?,
        "FWGN" | "FWGT" => header.field_weights = line.values()?,
        "VDXN" | "VDYN" | "VCXN" | "VCYN" | "VANN" => {
            line.refuse_unless_zero(
                "gives vignetting factors, which are not supported: apertures clip instead",
            )?;
        }
        "ZVDX" | "ZVDY" | "ZVCX" | "ZVCY" | "ZVAN" => {
            line.refuse_unless_zero("gives vignetting factors, which are not supported")?;
        }
        "WAVM" => header.waves.push((line.value(0)? as usize, line.value(1)?, line.value(2)?)),
        "WAVE" => header.wave_values = line.values()?,
        "WWGT" => {}
        "PWAV" => header.primary = line.value(0)? as usize,
        "MNUM" => {
            if line.value(0)? > 1.0 {
                return Err(line
                    .error("holds several configurations")
                    .help("save one configuration by itself"));
            }
        }
        _ => return Err(line.refused()),
    }
    Ok(())
}

fn surface_line(row: &mut Row, line: &Line<'_>) -> Result<(), InputError> {
    match line.key {
        "TYPE" => row.kind = line.words.first().copied().unwrap_or("STANDARD").to_owned(),
        "CURV" => row.curvature_per_mm = line.value(0)?,
        "CONI" => row.conic = line.value(0)?,
        "PARM" => {
            let (n, value) = (line.value(0)? as usize, line.value(1)?);
            match n {
                1..=8 => row.parameters[n - 1] = value,
                _ if value == 0.0 => {}
                _ => return Err(line.error("is a parameter that is not understood")),
            }
        }
        "DISZ" => {
            row.thickness_mm = match line.words.first() {
                Some(&"INFINITY") => f64::INFINITY,
                _ => line.value(0)?,
            }
        }
        "GLAS" => {
            let name = line.words.first().ok_or_else(|| line.error("names no glass"))?;
            row.glass = Some((line.line, (*name).to_owned()));
        }
        "DIAM" => {
            row.semi_diameter_mm = Some(line.value(0)?);
            // The second value is the solve: 0 automatic, 1 fixed, 2 picked up from another surface, 3 the
            // automatic one of all configurations.
            row.is_fixed = match line.words.get(1) {
                None | Some(&("0" | "3")) => false,
                Some(&("1" | "2")) => true,
                Some(_) => return Err(line.error("has an unknown kind of semi-diameter").expected("0 to 3")),
            };
        }
        // Clear aperture: circular with inner and outer radius.
        "CLAP" | "FLAP" => row.clear = Some([line.value(0)?, line.value(1)?]),
        "OBSC" => row.clear = Some([line.value(1)?, f64::INFINITY]),
        "OBDC" => line.refuse_unless_zero("decentres an aperture, which is not supported")?,
        "STOP" => row.stop = true,
        _ => return Err(line.refused()),
    }
    Ok(())
}

fn assemble(
    path: &Path,
    header: Header,
    rows: Vec<Row>,
    glasses: &GlassCatalogue,
) -> Result<OpticalSystem, InputError> {
    let whole = |problem: &str| InputError::new(path, problem);
    let unit = header.unit_mm;
    let (object_row, rows) = rows
        .split_first()
        .ok_or_else(|| whole("holds no surfaces").expected("a .zmx of a sequential system"))?;
    if object_row.curvature_per_mm != 0.0 || object_row.glass.is_some() {
        return Err(whole("the object must be a plane in air").line(object_row.line));
    }
    let object = if object_row.thickness_mm.is_infinite() || object_row.thickness_mm >= 1e10 {
        Object::Infinity
    } else {
        Object::Distance(object_row.thickness_mm * unit)
    };
    let mut surfaces =
        rows.iter().map(|row| surface(path, row, unit, glasses)).collect::<Result<Vec<_>, _>>()?;
    fixed_apertures(rows, unit, &mut surfaces);
    let stop = rows.iter().position(|row| row.stop).ok_or_else(|| {
        whole("the system has no stop")
            .expected("a STOP line below one surface")
            .help("mark one surface as the stop")
    })?;
    let beam = match header.beam {
        _ if header.beam_by_stop => {
            let row = &rows[stop];
            let semi = row.semi_diameter_mm.ok_or_else(|| {
                whole("the stop's size fixes the beam (FLOA), and it has none")
                    .line(row.line)
                    .expected("DIAM")
            })?;
            Beam::Stop(2.0 * semi * unit)
        }
        Some(Beam::EntrancePupil(diameter)) => Beam::EntrancePupil(diameter * unit),
        Some(beam) => beam,
        None => return Err(whole("the beam has no size").expected("ENPD, FNUM, OBNA or FLOA")),
    };
    let wavelengths = wavelengths(path, &header)?;
    let primary = header.primary.max(1) - 1;
    if primary >= wavelengths.len() {
        return Err(whole("PWAV names a wavelength that is not there").found(header.primary));
    }
    let mut system = OpticalSystem {
        name: if header.name.is_empty() { path.display().to_string() } else { header.name.clone() },
        object,
        fields: vec![Field { at: [0.0, 0.0], weight: 1.0 }],
        wavelengths,
        primary,
        beam,
        stop,
        surfaces,
        groups: Vec::new(),
        clear_fraction: 1.0,
        aiming: header.aiming,
    };
    system.check(path)?;
    system.fields = fields(path, &header, &system)?;
    system.check(path)?;
    Ok(system)
}

/// A fixed semi-diameter stops rays, as a floating aperture, where the surface bends light and has no
/// aperture of its own; an automatic one is the extent of the beam and stops none.
fn fixed_apertures(rows: &[Row], unit: f64, surfaces: &mut [Surface]) {
    for (i, row) in rows.iter().enumerate() {
        let before = if i == 0 { Medium::Air } else { surfaces[i - 1].medium.clone() };
        let bends = before != surfaces[i].medium || matches!(surfaces[i].shape, Shape::IdealLens { .. });
        if let (true, true, None, Some(semi)) = (bends, row.is_fixed, row.clear, row.semi_diameter_mm)
            && semi > 0.0
        {
            surfaces[i].aperture = Aperture::circle(semi * unit);
        }
    }
}

fn surface(path: &Path, row: &Row, unit: f64, glasses: &GlassCatalogue) -> Result<Surface, InputError> {
    let error = |problem: &str| InputError::new(path, problem).line(row.line);
    let curvature_per_mm = row.curvature_per_mm / unit;
    let has_parameters = row.parameters.iter().any(|&p| p != 0.0);
    let shape = match row.kind.as_str() {
        "STANDARD" if has_parameters => return Err(error("a STANDARD surface has no parameters")),
        "STANDARD" => Shape::Conic { curvature_per_mm, conic: row.conic },
        "EVENASPH" => Shape::EvenAsphere {
            curvature_per_mm,
            conic: row.conic,
            // a_2k has the unit length^(1 - 2k).
            coefficients: (0..8).map(|k| row.parameters[k] * unit.powi(-(2 * k as i32 + 1))).collect(),
        },
        "PARAXIAL" => {
            // Parameter 2 is the mode of its optical path, which has no influence on directions.
            if row.parameters[2..].iter().any(|&p| p != 0.0) {
                return Err(error("a PARAXIAL surface with these parameters is not understood"));
            }
            Shape::IdealLens { focal_mm: row.parameters[0] * unit }
        }
        kind if kind.starts_with("NONSEQ") => {
            return Err(error("a non-sequential part")
                .found(kind)
                .help("only sequential systems are traced"));
        }
        kind => {
            return Err(error("a surface type that is not understood")
                .found(kind)
                .expected("STANDARD, EVENASPH or PARAXIAL"));
        }
    };
    let medium = match &row.glass {
        None => Medium::Air,
        Some((line, name)) => match name.as_str() {
            "MIRROR" | "___BLANK" => {
                return Err(InputError::new(path, "mirrors and model glasses are not supported")
                    .line(*line)
                    .found(name)
                    .help("name a catalogue glass"));
            }
            name => Medium::Glass(glasses.require(path, name).map_err(|error| error.line(*line))?),
        },
    };
    let [inner, outer] = row.clear.unwrap_or([0.0, f64::INFINITY]);
    Ok(Surface {
        label: row.label.clone(),
        shape,
        thickness_mm: if row.thickness_mm.is_finite() { row.thickness_mm * unit } else { row.thickness_mm },
        medium,
        aperture: Aperture { inner_mm: inner * unit, outer_mm: outer * unit },
    })
}

fn wavelengths(path: &Path, header: &Header) -> Result<Vec<Wavelength>, InputError> {
    let whole = |problem: &str| InputError::new(path, problem);
    // WAVM lines run to 24 entries, of which the first FTYP's fourth number are in use.
    let all: Vec<Wavelength> = if header.waves.is_empty() {
        header.wave_values.iter().map(|um| Wavelength { nm: um * 1e3, weight: 1.0 }).collect()
    } else {
        header.waves.iter().map(|&(_, um, weight)| Wavelength { nm: um * 1e3, weight }).collect()
    };
    let count = if header.wave_count == 0 { all.len() } else { header.wave_count };
    if count == 0 || count > all.len() {
        return Err(whole("has no wavelengths").expected("WAVM lines, as many as FTYP says"));
    }
    Ok(all[..count].to_vec())
}

fn fields(path: &Path, header: &Header, system: &OpticalSystem) -> Result<Vec<Field>, InputError> {
    let whole = |problem: &str| InputError::new(path, problem);
    let count =
        if header.field_count == 0 { header.x.len().max(header.y.len()).max(1) } else { header.field_count };
    let at = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
    let kind = header.field_type.unwrap_or(0);
    let efl = match (kind, system.object) {
        (0, Object::Infinity) | (1, Object::Distance(_)) => 1.0,
        (2, Object::Infinity) => {
            let nm = system.primary_nm();
            let efl = efl_of_mm(system, 0, system.image() - 1, nm).map_err(|bad| whole(&bad.to_string()))?;
            efl.ok_or_else(|| whole("fields are image heights, and the system is afocal"))?
        }
        _ => {
            return Err(whole("fields of this type with this object are not supported").found(format!("FTYP {kind}"))
                .expected("angles (0) or paraxial image heights (2) for an object at infinity, object heights (1) else"));
        }
    };
    Ok((0..count)
        .map(|i| {
            let [x, y] = [at(&header.x, i), at(&header.y, i)];
            let at = match kind {
                0 => [x.to_radians().tan(), y.to_radians().tan()],
                1 => [x * header.unit_mm, y * header.unit_mm],
                _ => [x * header.unit_mm / efl, y * header.unit_mm / efl],
            };
            let weight = header.field_weights.get(i).copied().unwrap_or(1.0);
            Field { at, weight }
        })
        .collect())
}
