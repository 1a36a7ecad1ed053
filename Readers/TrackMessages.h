#pragma once
#include "TrackColumns.h"
#include "TrackRows.h"
#include "TrackSnapshot.h"

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace rimflow {

/// In quotes, in UTF-8, control characters replaced, cut after `most` bytes.
std::string printable(std::string_view text, std::size_t most = 40);
/// At most 12 digits, with a decimal point whatever the locale.
std::string shortNumber(double x);
/// The rest of the line from `begin` on (4 KiB at most), and the value that begins there.
std::string_view lineAt(std::string_view text, std::size_t begin);
std::string_view tokenAt(std::string_view text, std::size_t begin);

/// What is wrong with a row and what to do, without file and line. `offset`: of the fault in `text`;
/// `columnsKnownFrom`: such as "as many as there are VARIABLES".
std::string rowFault(const TrackRowsResult& result, std::string_view text, std::size_t offset,
                     const TrackColumnPlan& plan, const std::string& columnsKnownFrom);

extern const char* const trackLineTooLong;

/// Warning about particles that share a trackID; nothing when there are none.
std::optional<std::string> duplicateIds(const TrackSnapshot& snapshot);

/// "3 of 5 particles left out of <where>, the first one here: ...".
std::string notFiniteWarning(std::int64_t leftOut, std::int64_t rows, const std::string& where);

/// "the frame period of 0.001 s", or what is taken when it is not known (0) and how to set it.
std::string framePeriodWords(double framePeriod);

/// Why a file cannot be a text with tracks, from its first bytes (empty, binary, UTF-16, DaVis' own .set);
/// empty when it may be one.
std::string foreignFormat(std::string_view head);
/// What to export from DaVis instead of its own .set.
extern const char* const davisExportAdvice;

} // namespace rimflow
