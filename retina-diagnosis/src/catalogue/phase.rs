//! Effects on a body's phase curve, magnitudes added to a smooth Lambert sphere's.

use retina_formats::PhaseEffect;

use crate::data::{Dataset, Term};

use super::{Entry, Variant, need, plain};

pub(super) fn entry(effect: PhaseEffect) -> Entry {
    use PhaseEffect as E;
    match effect {
        E::LommelSeeliger => entry!(
            "a (m_LS - m_Lambert), a = 1 where the law is Lommel-Seeliger's",
            "H. Seeliger 1887; B. Hapke, Theory of Reflectance and Emittance Spectroscopy, 2nd ed., sec. 6.9",
            &["phase_deg"],
            "a = 1",
            None,
            lommel_seeliger
        ),
        E::PhaseFunction => entry!(
            "a |phase|, and its square and cube",
            "C. W. Allen, Astrophysical Quantities, 3rd ed., sec. 66",
            &["phase_deg"],
            "1.07 mag at 60 deg (the Moon)",
            Some(("phase_range", "below 7 and above 90 deg")),
            phase_function
        ),
        E::OppositionSurge => entry!(
            "-a exp(-|phase| / h)",
            "B. Hapke, Icarus 67, 1986",
            &["phase_deg"],
            "0.2 to 0.4 mag",
            Some(("phase_range", "below 7 deg")),
            surge
        ),
        E::Roughness => entry!(
            "a tan^2(|phase| / 2), which grows beyond 60 deg",
            "B. Hapke, Icarus 59, 1984",
            &["phase_deg"],
            "0.1 to 0.5 mag",
            Some(("phase_range", "above 90 deg")),
            roughness
        ),
        E::WaxingWaning => entry!(
            "a phase + b phase^3",
            "maria on one side; Allen",
            &["phase_deg"],
            "0.05 to 0.14 mag",
            None,
            waxing
        ),
        E::Extinction => {
            entry!("k X", "Bouguer's law", &["airmass"], "0.2 to 0.5 mag per airmass", None, extinction)
        }
    }
}

fn term<'a>(name: &str, values: Vec<f64>) -> Term<'a> {
    Term::new(name, move |i| [values[i], 0.0])
}

/// Integral phase function of Lommel-Seeliger's law: 1 + sin(a/2) tan(a/2) ln tan(a/4).
fn lommel_seeliger_magnitude(a: f64) -> f64 {
    if a == 0.0 {
        return 0.0;
    }
    -2.5 * (1.0 + (a / 2.0).sin() * (a / 2.0).tan() * (a / 4.0).tan().ln()).log10()
}

fn of_phase(data: &Dataset, value: impl Fn(f64) -> f64) -> Result<Vec<f64>, String> {
    Ok(need(data, "phase_deg")?.iter().map(|deg| value(deg.to_radians())).collect())
}

fn lommel_seeliger(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let lambert = crate::data::lambert_magnitude;
    Ok(plain(vec![term("a", of_phase(data, |a| lommel_seeliger_magnitude(a.abs()) - lambert(a.abs()))?)]))
}

fn phase_function(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: vec![term("mag_per_rad", of_phase(data, f64::abs)?)],
        further: vec![
            term("mag_per_rad2", of_phase(data, |a| a * a)?),
            term("mag_per_rad3", of_phase(data, |a| a.abs().powi(3))?),
        ],
    }])
}

fn surge(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let nearest = data.values("phase_deg").iter().map(|p| p.abs()).fold(f64::INFINITY, f64::min);
    if nearest > 7.0 {
        return Err(format!("column `phase_deg` begins at {nearest:.1} deg, and the surge lies below 7"));
    }
    [1.0, 2.0, 3.5, 6.0]
        .into_iter()
        .map(|h_deg: f64| {
            Ok(Variant {
                shape: vec![("h_deg", h_deg)],
                leading: vec![term("mag", of_phase(data, |a| -(-a.abs() / h_deg.to_radians()).exp())?)],
                // A peak with wings, as a sum of two.
                further: vec![term(
                    "mag_wings",
                    of_phase(data, |a| -(-a.abs() / (4.0 * h_deg).to_radians()).exp())?,
                )],
            })
        })
        .collect()
}

fn roughness(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let furthest = data.values("phase_deg").iter().map(|p| p.abs()).fold(0.0, f64::max);
    if furthest < 60.0 {
        return Err(format!("column `phase_deg` ends at {furthest:.1} deg, and roughness shows beyond 60"));
    }
    [2, 4]
        .into_iter()
        .map(|p| {
            Ok(Variant {
                shape: vec![("power_of_tan", f64::from(p))],
                leading: vec![term("mag", of_phase(data, |a| (a.abs() / 2.0).tan().powi(p))?)],
                further: Vec::new(),
            })
        })
        .collect()
}

fn waxing(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    let phase = need(data, "phase_deg")?;
    if phase.iter().all(|p| *p >= 0.0) || phase.iter().all(|p| *p <= 0.0) {
        return Err("column `phase_deg` has one sign alone".into());
    }
    Ok(vec![Variant {
        shape: Vec::new(),
        leading: vec![term("mag_per_rad", of_phase(data, |a| a)?)],
        further: vec![term("mag_per_rad3", of_phase(data, |a| a.powi(3))?)],
    }])
}

fn extinction(data: &Dataset) -> Result<Vec<Variant<'_>>, String> {
    Ok(plain(vec![term("mag_per_airmass", need(data, "airmass")?.to_vec())]))
}
