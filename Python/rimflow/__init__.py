"""RIMFlow: from Shake-The-Box tracks to the invisible sphere. The wrapped VTK classes are vtkRIMFlowReaders and vtkRIMFlowFilters."""
