//! Errors that a table states in most of its rows.

/// A column of stated errors in which some cells are empty, which means not measured: these rows take the median of the
/// others. No values where fewer than half of the rows state one. The note is what the user ought to know of it.
pub fn stated_by_most(
    column: &str,
    values: impl Iterator<Item = Option<f64>>,
) -> (Option<Vec<f64>>, Option<String>) {
    let values: Vec<Option<f64>> = values.collect();
    let mut stated: Vec<f64> = values.iter().flatten().copied().collect();
    if stated.is_empty() {
        return (None, None);
    }
    stated.sort_by(f64::total_cmp);
    let (median, empty) = (stated[stated.len() / 2], values.len() - stated.len());
    let enough = empty <= stated.len();
    let note = (empty > 0).then(|| {
        let then = if enough { "these take the median of the others" } else { "it is not used" };
        format!("column `{column}` is empty in {empty} of {} rows: {then}", values.len())
    });
    (enough.then(|| values.into_iter().map(|value| value.unwrap_or(median)).collect()), note)
}

#[cfg(test)]
mod tests {
    use super::stated_by_most;

    #[test]
    fn an_empty_cell_takes_the_median_and_most_empty_cells_take_the_column() {
        let of = |values: &[Option<f64>]| stated_by_most("sigma_px", values.iter().copied());
        let (values, note) = of(&[Some(1.0), None, Some(5.0), Some(2.0)]);
        assert_eq!(values, Some(vec![1.0, 2.0, 5.0, 2.0]));
        assert!(note.is_some_and(|note| note.contains("empty in 1 of 4 rows: these take the median")));
        let (values, note) = of(&[Some(1.0), None, None]);
        assert!(values.is_none() && note.is_some_and(|note| note.contains("it is not used")));
        assert_eq!(of(&[None, None]), (None, None));
    }
}
