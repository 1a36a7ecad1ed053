#pragma once

namespace rimflow {

/// What is known of a sphere's centre at one time: the array `Status`.
enum class CentreStatus { Found = 0, Predicted = 1, Lost = 2 };

} // namespace rimflow
