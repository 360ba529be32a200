//! Errors that a table states in most of its rows.

/// A column of stated errors in which some cells are empty, which means not measured: these rows take the median of the
/// others. `None` where fewer than half of the rows state one.
pub fn stated_by_most(values: impl Iterator<Item = Option<f64>>) -> Option<Vec<f64>> {
    let values: Vec<Option<f64>> = values.collect();
    let mut stated: Vec<f64> = values.iter().flatten().copied().collect();
    if stated.is_empty() || 2 * stated.len() < values.len() {
        return None;
    }
    stated.sort_by(f64::total_cmp);
    let median = stated[stated.len() / 2];
    Some(values.into_iter().map(|value| value.unwrap_or(median)).collect())
}

#[cfg(test)]
mod tests {
    use super::stated_by_most;

    #[test]
    fn an_empty_cell_takes_the_median_and_most_empty_cells_take_the_column() {
        let of = |values: &[Option<f64>]| stated_by_most(values.iter().copied());
        assert_eq!(of(&[Some(1.0), None, Some(5.0), Some(2.0)]), Some(vec![1.0, 2.0, 5.0, 2.0]));
        assert_eq!(of(&[Some(1.0), None, None]), None);
        assert_eq!(of(&[]), None);
    }
}
