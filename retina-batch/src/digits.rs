//! Digits of 3 x 5 dots, to number the frames of a contact sheet.

/// Rows from top to bottom; the highest of three bits is the left dot.
const DIGITS: [[u8; 5]; 10] = [
    [0b111, 0b101, 0b101, 0b101, 0b111],
    [0b010, 0b110, 0b010, 0b010, 0b111],
    [0b111, 0b001, 0b111, 0b100, 0b111],
    [0b111, 0b001, 0b111, 0b001, 0b111],
    [0b101, 0b101, 0b111, 0b001, 0b001],
    [0b111, 0b100, 0b111, 0b001, 0b111],
    [0b111, 0b100, 0b111, 0b101, 0b111],
    [0b111, 0b001, 0b010, 0b010, 0b010],
    [0b111, 0b101, 0b111, 0b101, 0b111],
    [0b111, 0b101, 0b111, 0b001, 0b111],
];

/// Calls `dot` with the pixels of a number, `size` pixels a dot, its corner at (0, 0).
pub(crate) fn draw(number: usize, size: usize, mut dot: impl FnMut(usize, usize)) {
    for (place, digit) in number.to_string().bytes().enumerate() {
        for (row, bits) in DIGITS[usize::from(digit - b'0')].iter().enumerate() {
            for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                for part in 0..size * size {
                    dot((4 * place + column) * size + part % size, row * size + part / size);
                }
            }
        }
    }
}
