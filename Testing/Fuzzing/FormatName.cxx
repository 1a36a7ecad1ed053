// The parser that a target fuzzes: all else is the same for all of them.
extern const char* const fuzzedFormat;
const char* const fuzzedFormat = RIMFLOW_FUZZ_FORMAT;
