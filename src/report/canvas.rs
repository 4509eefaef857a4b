//! A picture in memory: drawn on with plotters, averaged down, encoded as PNG.

use std::sync::Once;

use plotters::backend::BitMapBackend;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::style::{Color, FontStyle, IntoFont, RGBColor, TextStyle, register_font};

use super::ReportError;

/// Pixels that are drawn for a pixel of the picture, along each axis.
pub const OVERSAMPLING: u32 = 2;

/// Text and axes.
pub const INK: RGBColor = RGBColor(40, 44, 52);
/// Grid lines and what is only mentioned.
pub const FAINT: RGBColor = RGBColor(226, 229, 233);
/// Secondary text.
pub const GREY: RGBColor = RGBColor(110, 117, 128);
/// A measurement behind its mean.
pub const PALE: RGBColor = RGBColor(174, 199, 220);
/// Colours that people with any colour vision tell apart (Okabe and Ito 2008), ordered for a white ground.
pub const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// Where plotters draws.
pub type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// A picture while it is drawn; sizes are those of the finished one.
pub struct Canvas {
    width: u32,
    height: u32,
    pixels: Vec<u8>,
}

impl Canvas {
    /// A white canvas of `width` x `height` pixels.
    pub fn new(width: u32, height: u32) -> Self {
        let samples = (width * height * OVERSAMPLING * OVERSAMPLING) as usize;
        Self {
            width,
            height,
            pixels: vec![255; 3 * samples],
        }
    }

    /// Width in samples.
    pub fn columns(&self) -> usize {
        (self.width * OVERSAMPLING) as usize
    }

    /// Samples row by row from the top left, three bytes each.
    pub fn samples(&mut self) -> &mut [u8] {
        &mut self.pixels
    }

    /// Draws with plotters, whose coordinates are samples: see [`px`].
    ///
    /// # Errors
    /// Whatever `draw` fails with.
    pub fn draw(&mut self, draw: impl FnOnce(&Area<'_>) -> Result<(), ReportError>) -> Result<(), ReportError> {
        let size = (self.width * OVERSAMPLING, self.height * OVERSAMPLING);
        let area = BitMapBackend::with_buffer(&mut self.pixels, size).into_drawing_area();
        draw(&area)?;
        area.present().map_err(ReportError::draw)
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// [`ReportError::Draw`] when it cannot be encoded.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        encoder.set_filter(png::Filter::NoFilter);
        let mut writer = encoder.write_header().map_err(ReportError::draw)?;
        writer.write_image_data(&self.averaged()).map_err(ReportError::draw)?;
        writer.finish().map_err(ReportError::draw)?;
        Ok(out)
    }

    fn averaged(&self) -> Vec<u8> {
        let n = OVERSAMPLING as usize;
        let (width, height, columns) = (self.width as usize, self.height as usize, self.columns());
        let mut out = Vec::with_capacity(3 * width * height);
        for (y, x, channel) in (0..height).flat_map(|y| (0..3 * width).map(move |i| (y, i / 3, i % 3))) {
            let sample = |k: usize| 3 * ((n * y + k / n) * columns + n * x + k % n) + channel;
            let sum: usize = (0..n * n).map(|k| usize::from(self.pixels[sample(k)])).sum();
            out.push(((sum + n * n / 2) / (n * n)) as u8);
        }
        out
    }
}

/// A length in pixels of the picture as samples.
pub fn px(pixels: i32) -> i32 {
    pixels * OVERSAMPLING as i32
}

/// Text of `size` pixels.
pub fn text(size: i32, colour: RGBColor) -> TextStyle<'static> {
    static FONT: Once = Once::new();
    // A font that does not parse shows in the first text that is drawn, as an error.
    FONT.call_once(|| drop(register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular())));
    ("sans-serif", px(size)).into_font().color(&colour.to_rgba())
}

/// Writes a line of text with its left end at `x` and its top at `y`, samples; gives the x where it ends.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn write(area: &Area<'_>, line: &str, style: &TextStyle<'_>, (x, y): (i32, i32)) -> Result<i32, ReportError> {
    area.draw_text(line, style, (x, y)).map_err(ReportError::draw)?;
    let (width, _) = area.estimate_text_size(line, style).map_err(ReportError::draw)?;
    Ok(x + width as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_the_average_of_its_samples() {
        let mut canvas = Canvas::new(3, 2);
        let columns = canvas.columns();
        for row in 0..2 {
            // Half of the samples of the pixel in the middle above.
            let at = 3 * (row * columns + 2);
            canvas.samples()[at..at + 3].copy_from_slice(&[55, 155, 255]);
        }
        let png = canvas.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(pixels[3..6], [155, 205, 255]);
        let others = pixels[..3].iter().chain(&pixels[6..]);
        assert!(others.into_iter().all(|&x| x == 255));
    }
}
