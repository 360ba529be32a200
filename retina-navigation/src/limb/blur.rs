//! How blurred a limb is: the width of the PSF that fits its edges best.

use retina_image::CameraImage;

use super::edge::{Node, Sample, crossing, fit_edge, pixels};

/// Widths of blur that are tried first, px: from a bare pixel (1 / sqrt 12) up.
const BLURS_PX: [f64; 7] = [0.3, 0.5, 0.83, 1.4, 2.3, 3.9, 6.5];
/// Nodes that the blur is found from.
const NODES: usize = 48;
/// Precision of the blur's logarithm.
const PRECISION: f64 = 0.002;
/// Steps towards the best blur at most: each is a parabola's, or a golden section's.
const MOST_STEPS: usize = 12;
/// The golden section's smaller part.
const GOLDEN: f64 = 0.381_966_011_25;

/// Why no blur is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoBlur {
    /// Too few nodes show an edge.
    FewEdges,
    /// It is wider than any that is tried.
    TooWide,
}

/// The blur that fits the edges of a sample of nodes best, px.
pub(super) fn blur(
    image: &CameraImage,
    nodes: &[Node],
    half_width_px: f64,
    noise_dn: f64,
) -> Result<f64, NoBlur> {
    let step = (nodes.len() / NODES).max(1);
    let mut sample: Vec<(Node, Vec<Sample>, f64)> = nodes
        .iter()
        .step_by(step)
        .filter_map(|node| {
            let (samples, _) = pixels(image, node, half_width_px)?;
            let start = crossing(&samples, half_width_px, noise_dn)?;
            (start.abs() < 0.5 * half_width_px).then_some((*node, samples, start))
        })
        .collect();
    if sample.len() < 4 {
        return Err(NoBlur::FewEdges);
    }
    // Medians over the nodes: a crater's edge in one does not decide. Each fit begins where the one before ended.
    let mut misfit = |log_blur: f64| {
        let mut each: Vec<f64> = sample
            .iter_mut()
            .map(|(node, samples, start)| {
                match fit_edge(node, samples, *start, half_width_px, log_blur.exp(), noise_dn) {
                    None => f64::INFINITY,
                    Some(edge) => {
                        *start = edge.blurred_shift_px;
                        edge.misfit.0 / edge.misfit.1 as f64
                    }
                }
            })
            .collect();
        let middle = each.len() / 2;
        *each.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let mut tried = [[0.0, f64::INFINITY]; BLURS_PX.len()];
    let mut best = 0;
    for (k, blur_px) in BLURS_PX.into_iter().enumerate() {
        tried[k] = [blur_px.ln(), misfit(blur_px.ln())];
        if tried[k][1] < tried[best][1] {
            best = k;
        }
        // Two steps beyond the best fit, and far worse: wider ones are worse still.
        if k >= best + 2 && tried[k][1] > 2.0 * tried[best][1] {
            break;
        }
    }
    if !tried[best][1].is_finite() || best + 1 == BLURS_PX.len() {
        return Err(NoBlur::TooWide);
    }
    Ok(minimum([tried[best.saturating_sub(1)], tried[best], tried[best + 1]], misfit).exp())
}

/// The place of the minimum of a function between two others ([place, value] each) where it is greater: by parabolas
/// through the three best known places, and by golden sections where there is none.
fn minimum([mut low, mut middle, mut high]: [[f64; 2]; 3], mut value: impl FnMut(f64) -> f64) -> f64 {
    for _ in 0..MOST_STEPS {
        let [to_low, to_high] = [middle[0] - low[0], middle[0] - high[0]];
        let [by_low, by_high] = [to_low * (middle[1] - high[1]), to_high * (middle[1] - low[1])];
        let mut step = -0.5 * (to_low * by_low - to_high * by_high) / (by_low - by_high);
        if !step.is_finite() || step <= -to_low || step >= -to_high {
            step = if to_low > -to_high { -GOLDEN * to_low } else { -GOLDEN * to_high };
        }
        if step.abs() < PRECISION {
            return middle[0] + step;
        }
        let next = [middle[0] + step, value(middle[0] + step)];
        let (inner, outer) = if next[1] < middle[1] { (next, middle) } else { (middle, next) };
        if outer[0] < inner[0] {
            low = outer;
        } else {
            high = outer;
        }
        middle = inner;
    }
    middle[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minima_are_found_with_and_without_a_parabola() {
        let known = |at: [f64; 3], of: fn(f64) -> f64| at.map(|x| [x, of(x)]);
        // cosh(x - 0.3) is no parabola; its minimum is at 0.3.
        let found = minimum(known([-0.5, 0.1, 1.2], |x| (x - 0.3).cosh()), |x| (x - 0.3).cosh());
        assert!((found - 0.3).abs() < 0.003, "{found}");
        // A corner, one side of which is not a number that counts.
        let corner = |x: f64| if x < -0.2 { f64::INFINITY } else { (x - 0.3).abs() };
        let found = minimum(known([-0.5, 0.1, 1.2], corner), corner);
        assert!((found - 0.3).abs() < 0.03, "{found}");
        // The least of all is at the edge.
        let found = minimum(known([0.0, 0.0, 1.0], |x| x), |x| x);
        assert!(found.abs() < 0.02, "{found}");
    }
}
