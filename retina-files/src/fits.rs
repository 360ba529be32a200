//! Headers of FITS files (FITS standard 4.0, sections 3 and 4).

/// Bytes of a card, and of a block, which headers and data fill wholly.
const CARD_BYTES: usize = 80;
const BLOCK_BYTES: usize = 2880;

/// A header, card by card.
#[derive(Debug, Clone, Default)]
pub struct FitsHeader {
    cards: Vec<String>,
}

impl FitsHeader {
    /// The header of an array of so many bits a sample (negative: floating point) and these axes, the fastest first.
    pub fn of_array(bits: i64, axes: &[usize]) -> Self {
        let mut out = Self::default();
        out.logical("SIMPLE", true).integer("BITPIX", bits).integer("NAXIS", axes.len() as i64);
        for (k, length) in axes.iter().enumerate() {
            out.integer(&format!("NAXIS{}", k + 1), *length as i64);
        }
        out
    }

    /// Adds a truth value.
    pub fn logical(&mut self, key: &str, value: bool) -> &mut Self {
        self.card(key, format!("{:>20}", if value { "T" } else { "F" }))
    }

    /// Adds a whole number.
    pub fn integer(&mut self, key: &str, value: i64) -> &mut Self {
        self.card(key, format!("{value:>20}"))
    }

    /// Adds a number.
    pub fn real(&mut self, key: &str, value: f64) -> &mut Self {
        self.card(key, format!("{:>20}", format!("{value:.13E}")))
    }

    /// Adds a text of at most 68 characters of ASCII; what is more is cut off.
    pub fn text(&mut self, key: &str, value: &str) -> &mut Self {
        let plain: String = value.chars().filter(|c| (' '..='~').contains(c)).take(68).collect();
        self.card(key, format!("'{:<8}'", plain.replace('\'', "''")))
    }

    fn card(&mut self, key: &str, value: String) -> &mut Self {
        let mut card = format!("{key:<8}= {value}");
        card.truncate(CARD_BYTES);
        self.cards.push(card);
        self
    }

    /// The header's bytes, whole blocks.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> =
            self.cards.iter().flat_map(|card| format!("{card:<CARD_BYTES$}").into_bytes()).collect();
        bytes.extend(format!("{:<CARD_BYTES$}", "END").into_bytes());
        bytes.resize(bytes.len().div_ceil(BLOCK_BYTES) * BLOCK_BYTES, b' ');
        bytes
    }

    /// The header and its array's samples, high bytes first, as a file.
    pub fn with_data(&self, samples: &[u8]) -> Vec<u8> {
        let mut bytes = self.bytes();
        bytes.extend_from_slice(samples);
        bytes.resize(bytes.len().div_ceil(BLOCK_BYTES) * BLOCK_BYTES, 0);
        bytes
    }
}
