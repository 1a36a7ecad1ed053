// When did anything change that a filter's input comes from? Header only, internal.
#ifndef vtkUpstream_h
#define vtkUpstream_h

#include "vtkAlgorithm.h"
#include "vtkAlgorithmOutput.h"

#include <algorithm>

namespace rimflow {

/// The latest MTime of the algorithms that feed one input port, or (port < 0) all of them. A change of the
/// pipeline's time does not count: it modifies no algorithm.
inline vtkMTimeType upstreamMTime(vtkAlgorithm* algorithm, int port = -1) {
  vtkMTimeType latest = 0;
  for (int p = 0; p < algorithm->GetNumberOfInputPorts(); ++p)
    for (int c = 0; (port < 0 || p == port) && c < algorithm->GetNumberOfInputConnections(p); ++c) {
      vtkAlgorithm* producer = algorithm->GetInputConnection(p, c)->GetProducer();
      latest = std::max({latest, producer->GetMTime(), upstreamMTime(producer)});
    }
  return latest;
}

} // namespace rimflow

#endif
