#include "core/drawing/lettering.h"

#include <algorithm>
#include <array>

namespace saltus::drawing {
namespace {

/// From ' ' to '~'. Strokes are separated by spaces, their points are pairs of digits: right, and up with the baseline
/// at 2, the top of small letters at 6 and of capitals at 8.
constexpr std::array<const char*, 95> glyphs{"",                                         // space
                                             "0804 0202",                                // !
                                             "0807 2827",                                // "
                                             "1218 3238 0444 0646",                      // #
                                             "473818070615354443321203 2921",            // $
                                             "0248 0818170708 3343423233",               // %
                                             "42071728362312031435",                     // &
                                             "0807",                                     // '
                                             "18070312",                                 // (
                                             "08171302",                                 // )
                                             "2527 0636 0735 0537",                      // *
                                             "0444 2226",                                // +
                                             "1201",                                     // ,
                                             "0424",                                     // -
                                             "0202",                                     // .
                                             "0138",                                     // /
                                             "180703122233372818",                       // 0
                                             "071812",                                   // 1
                                             "07182837360232",                           // 2
                                             "07182837362515 253433221203",              // 3
                                             "22280434",                                 // 4
                                             "380805253433221203",                       // 5
                                             "372818070312223334251504",                 // 6
                                             "083812",                                   // 7
                                             "15060718283736251504031222333425",         // 8
                                             "031222333728180706152536",                 // 9
                                             "0202 0505",                                // :
                                             "1201 1515",                                // ;
                                             "360432",                                   // <
                                             "0343 0545",                                // =
                                             "063402",                                   // >
                                             "07182837361514 1212",                      // ?
                                             "332324343635252636 36473828170603123242",  // @
                                             "022842 1535",                              // A
                                             "02083847463505 3544433202",                // B
                                             "4738180703123243",                         // C
                                             "02082846442202",                           // D
                                             "48080242 0535",                            // E
                                             "480802 0535",                              // F
                                             "47381807031232434525",                     // G
                                             "0208 4248 0545",                           // H
                                             "0208",                                     // I
                                             "3833221203",                               // J
                                             "0208 4804 1542",                           // K
                                             "080242",                                   // L
                                             "0208254842",                               // M
                                             "02084248",                                 // N
                                             "180703123243473818",                       // O
                                             "02083847463505",                           // P
                                             "180703123243473818 2442",                  // Q
                                             "02083847463505 2542",                      // R
                                             "473818070615354443321203",                 // S
                                             "0848 2822",                                // T
                                             "080312324348",                             // U
                                             "082248",                                   // V
                                             "0812253248",                               // W
                                             "0842 0248",                                // X
                                             "082548 2522",                              // Y
                                             "08480242",                                 // Z
                                             "18080212",                                 // [
                                             "0831",                                     // backslash
                                             "08181202",                                 // ]
                                             "062846",                                   // ^
                                             "0141",                                     // _
                                             "0817",                                     // `
                                             "3632 3526160503122233",
                                             "0802 0516263533221203",  // a b
                                             "3526160503122233",
                                             "3832 3526160503122233",  // c d
                                             "04343526160503122233",
                                             "28181712 0626",  // e f
                                             "3631201001 3526160503122233",
                                             "0802 0516263532",  // g h
                                             "0602 0808",
                                             "161100 1818",
                                             "0802 3603 1432",
                                             "080312",  // i j k l
                                             "0602 05162522 25364542",
                                             "0602 0516263532",  // m n
                                             "160503122233352616",
                                             "0600 0516263533221203",  // o p
                                             "3630 3526160503122233",
                                             "0602 051626",
                                             "3616051424332202",  // q r s
                                             "18132232 0626",
                                             "0603122233 3632",
                                             "062246",  // t u v
                                             "0612253246",
                                             "0632 0236",
                                             "0622 4610",
                                             "06360232",  // w x y z
                                             "28171605141322",
                                             "0108",
                                             "08171625141302",  // { | }
                                             "0415243435"};     // ~

constexpr double gap = 1.7, space = 2.2;  // in steps of the digits

const char* glyph_of(char letter) {
  const auto code = static_cast<unsigned char>(letter);
  return glyphs[code >= 32 && code < 127 ? code - 32 : '?' - 32];
}

double width_of(const char* glyph) {
  if (*glyph == '\0') return space;
  int widest = 0;
  for (const char* at = glyph; *at; ++at) {
    if (*at == ' ') continue;
    widest = std::max(widest, *at - '0');
    ++at;
  }
  return widest;
}

/// The text from (0, 0) to the right, y downwards, in pixels.
Strokes strokes_of(std::string_view text, double step) {
  Strokes strokes;
  double left = 0;
  for (char letter : text) {
    const char* glyph = glyph_of(letter);
    if (*glyph) strokes.emplace_back();
    for (const char* at = glyph; *at; ++at) {
      if (*at == ' ') {
        strokes.emplace_back();
        continue;
      }
      strokes.back().emplace_back((left + at[0] - '0') * step, (2 - (at[1] - '0')) * step);
      ++at;
    }
    left += width_of(glyph) + gap;
  }
  return strokes;
}

template <class Turn>
void write_turned(Raster& raster, std::string_view text, const Vector<2>& at, const TextStyle& style,
                  const Turn& turn) {
  const double width = text_width(text, style.height);
  const double shift = style.anchor == TextAnchor::Start ? 0 : style.anchor == TextAnchor::Middle ? width / 2 : width;
  Strokes strokes = strokes_of(text, style.height / 6);
  for (Stroke& stroke : strokes)
    for (Vector<2>& point : stroke) point = at + turn(Vector<2>(point[0] - shift, point[1]));
  draw(raster, strokes, {style.colour, std::max(1.0, style.height / 8), 1});
}

}  // namespace

double text_width(std::string_view text, double height) {
  double steps = 0;
  for (char letter : text) steps += width_of(glyph_of(letter)) + gap;
  return text.empty() ? 0 : (steps - gap) * height / 6;
}

void write(Raster& raster, std::string_view text, const Vector<2>& at, const TextStyle& style) {
  write_turned(raster, text, at, style, [](const Vector<2>& point) { return point; });
}

void write_upwards(Raster& raster, std::string_view text, const Vector<2>& at, const TextStyle& style) {
  write_turned(raster, text, at, style, [](const Vector<2>& point) { return Vector<2>(point[1], -point[0]); });
}

}  // namespace saltus::drawing
