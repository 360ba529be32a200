//! Which frames of a sequence are asked for.

use std::str::FromStr;

use retina_files::InputError;

/// Frames from `first` on, up to but without `end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRange {
    /// First frame.
    pub first: usize,
    /// The frame after the last; `None` is the sequence's end.
    pub end: Option<usize>,
}

impl FromStr for FrameRange {
    type Err = String;

    /// `A..B`, `A..` or `..B`, B excluded.
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted =
            || format!("`{text}` is not a range of frames; expected A..B (B excluded), for example 0..24");
        let (first, end) = text.split_once("..").ok_or_else(wanted)?;
        let number = |part: &str| part.parse::<usize>().map_err(|_| wanted());
        let first = if first.is_empty() { 0 } else { number(first)? };
        let end = if end.is_empty() { None } else { Some(number(end)?) };
        if end.is_some_and(|end| end <= first) {
            return Err(format!("the range `{text}` holds no frame; B is excluded and must be above A"));
        }
        Ok(Self { first, end })
    }
}

/// One of N parts of a sequence: the frames whose number is `index` modulo `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Which part, from 0.
    pub index: usize,
    /// How many parts.
    pub count: usize,
}

impl FromStr for Shard {
    type Err = String;

    /// `I/N` with I from 0 to N - 1.
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted =
            || format!("`{text}` is not a shard; expected I/N with I from 0 to N - 1, for example 0/4");
        let (index, count) = text.split_once('/').ok_or_else(wanted)?;
        let number = |part: &str| part.parse::<usize>().map_err(|_| wanted());
        let (index, count) = (number(index)?, number(count)?);
        if index < count { Ok(Self { index, count }) } else { Err(wanted()) }
    }
}

/// The frames that a run is to make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Selection {
    /// A range; `None` is all.
    pub range: Option<FrameRange>,
    /// Every so many frames of the range, from its first; `None` is each.
    pub every: Option<usize>,
    /// A shard of those.
    pub shard: Option<Shard>,
}

impl Selection {
    /// The frames' numbers, rising; empty only where a shard has none.
    ///
    /// # Errors
    /// A range without frames or beyond the sequence's end, a step of 0.
    pub fn frames(&self, frame_count: usize) -> Result<Vec<usize>, InputError> {
        let first = self.range.map_or(0, |range| range.first);
        let end = self.range.and_then(|range| range.end).unwrap_or(frame_count);
        if first >= end || end > frame_count {
            return Err(InputError::new("--frames", "the frames asked for are not all in the sequence")
                .found(format!("{first}..{end}"))
                .expected(format!("within 0..{frame_count}")));
        }
        let every = self.every.unwrap_or(1);
        if every == 0 {
            return Err(InputError::new("--every", "a step of 0 selects nothing").expected("1 or more"));
        }
        let mine = |index: &usize| self.shard.is_none_or(|shard| index % shard.count == shard.index);
        Ok((first..end).step_by(every).filter(mine).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_shards_are_parsed_or_refused() {
        assert_eq!("3..7".parse(), Ok(FrameRange { first: 3, end: Some(7) }));
        assert_eq!("3..".parse(), Ok(FrameRange { first: 3, end: None }));
        assert_eq!("1/4".parse(), Ok(Shard { index: 1, count: 4 }));
        for bad in ["", "3", "7..3", "3..3", "a..b", "-1..2", "1...3"] {
            assert!(bad.parse::<FrameRange>().is_err(), "{bad}");
        }
        for bad in ["", "1", "4/4", "0/0", "a/2", "-1/2"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
    }

    #[test]
    fn shards_part_the_selection() {
        let all = Selection { range: "2..20".parse().ok(), every: Some(3), shard: None };
        assert_eq!(all.frames(20).unwrap(), [2, 5, 8, 11, 14, 17]);
        let mut parts: Vec<usize> = (0..4)
            .flat_map(|index| Selection { shard: Some(Shard { index, count: 4 }), ..all }.frames(20).unwrap())
            .collect();
        parts.sort_unstable();
        assert_eq!(parts, all.frames(20).unwrap());
        assert!(all.frames(19).unwrap_err().to_string().contains("0..19"));
        assert!(Selection { every: Some(0), ..all }.frames(20).is_err());
    }
}
