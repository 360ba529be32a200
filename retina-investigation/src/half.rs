//! What a search in one half of a table comes to, and what the other half says of it.

use std::sync::atomic::AtomicUsize;

use retina_diagnosis::{Dataset, Halves, Part, Proof, Remainder};

use crate::columns::{Column, Table};
use crate::form::Form;
use crate::rivals::sum;
use crate::search::{Scored, Search, finite, simplest};

/// A table to look for formulas in.
#[derive(Clone, Copy)]
pub(crate) struct Sought<'a> {
    pub(crate) data: &'a Dataset,
    pub(crate) columns: &'a [Column],
    /// All its rows.
    pub(crate) whole: &'a Table,
    /// Seed of the sign flips.
    pub(crate) seed: u64,
    pub(crate) progress: &'a (dyn Fn(&str, f64) + Sync),
}

/// What was found in one half.
pub(crate) struct InHalf {
    /// Forms, best first.
    pub(crate) scored: Vec<Scored>,
    /// The one that the search chose.
    pub(crate) chosen: Form,
    /// Its amplitudes in this half.
    pub(crate) amplitudes: Vec<f64>,
    /// What the other half says of it.
    pub(crate) proof: Proof,
}

/// Judges forms whose amplitudes are fitted in one half by the other one.
pub(crate) struct Judge<'a> {
    sought: Sought<'a>,
    halves: &'a Halves,
    searched: Table,
    left: Remainder<'a>,
}

impl<'a> Sought<'a> {
    pub(crate) fn search<'b>(&self, part: Part, table: &'b Table) -> Search<'b>
    where
        'a: 'b,
    {
        Search {
            kind: self.data.kind,
            columns: self.columns,
            part,
            table,
            tried: AtomicUsize::new(0),
            progress: self.progress,
        }
    }

    /// Looks for a form in the half that is searched, and judges it; adds the number of forms to `tried`.
    pub(crate) fn in_half(&self, halves: &Halves, tried: &mut usize) -> Option<InHalf> {
        let searched = self.whole.of_rows(halves.searched_rows());
        let search = self.search(Part::Half, &searched);
        let found = search.run(halves, None);
        *tried += found.tried;
        (self.progress)("judging", 0.9);
        let judge = Judge::new(*self, halves, &found.scored.first()?.form);
        let (chosen, _) = simplest(&judge.left, &search, &found.scored)?;
        let chosen = found.scored[chosen].form.clone();
        let (amplitudes, proof) = (judge.amplitudes(&chosen), judge.prove(&chosen));
        Some(InHalf { scored: found.scored, chosen, amplitudes, proof })
    }
}

impl<'a> Judge<'a> {
    /// `first` is the form by which the half that is searched is weighed.
    pub(crate) fn new(sought: Sought<'a>, halves: &'a Halves, first: &Form) -> Self {
        let searched = sought.whole.of_rows(halves.searched_rows());
        let left = halves.left(Part::Half, &finite(first.evaluate(&searched, sought.columns)));
        Self { sought, halves, searched, left }
    }

    fn amplitudes(&self, form: &Form) -> Vec<f64> {
        let evaluated = finite(form.evaluate(&self.searched, self.sought.columns));
        self.left.amplitudes(&evaluated).iter().map(|(value, _)| *value).collect()
    }

    /// The halves may change places once, which is two trials: p-values are twice those of one.
    pub(crate) fn prove(&self, form: &Form) -> Proof {
        let own = finite(form.evaluate(self.sought.whole, self.sought.columns));
        let predicted = sum(&own, self.amplitudes(form).into_iter());
        let proof = self.halves.prove(&predicted, &own, self.sought.seed);
        Proof { p_value: (2.0 * proof.p_value).min(1.0), ..proof }
    }
}
